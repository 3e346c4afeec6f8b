"""A chain of effects in the order of their places; pure functions of values and states."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.effects.effect import (
    CommandEffect,
    Effect,
    SensorEffect,
    Setting,
    Signals,
    Values,
    VelocityEffect,
)

ChainValues = Mapping[str, Values]  # by family
NeutralValues = Mapping[str, Mapping[str, np.ndarray]]
ChainState = dict[str, Any]


class Chain:
    """The effects that act on one machine, one per family."""

    def __init__(self, effects: Sequence[type[Effect]], setting: Setting) -> None:
        ordered = sorted(effects, key=lambda effect: (effect.place, effect.card.family))
        self.setting = setting
        self.effects = {effect.card.family: effect(setting) for effect in ordered}
        self._command = {f: e for f, e in self.effects.items() if isinstance(e, CommandEffect)}
        self._velocity = {f: e for f, e in self.effects.items() if isinstance(e, VelocityEffect)}
        self._sensor = {f: e for f, e in self.effects.items() if isinstance(e, SensorEffect)}

    def neutral(self) -> dict[str, dict[str, np.ndarray]]:
        """Values at which the whole chain is the identity."""
        return {family: effect.neutral() for family, effect in self.effects.items()}

    def initial(self, batch: tuple[int, ...]) -> ChainState:
        """States of a machine that has been at rest."""
        return {family: effect.initial(batch) for family, effect in self.effects.items()}

    def drawn(self, values: ChainValues, key: jax.Array) -> ChainState:
        """States of a machine that has been at rest, without batch axes; see `Effect.drawn`. `key` is consumed."""
        keys = jax.random.split(key, len(self.effects))
        return {
            family: effect.drawn(values[family], own)
            for own, (family, effect) in zip(keys, self.effects.items(), strict=True)
        }

    def commands(
        self, values: ChainValues, state: ChainState, command: jax.Array
    ) -> tuple[ChainState, jax.Array]:
        """One step of the command effects, (..., n_joint)."""
        state = dict(state)
        for family, effect in self._command.items():
            state[family], command = effect.apply(values[family], state[family], command)
        return state, command

    def velocity(
        self, values: ChainValues, state: ChainState, u: jax.Array, signals: Signals
    ) -> tuple[ChainState, jax.Array]:
        """One step of the velocity effects: the nominal machine's velocity to the machine's, (..., n_joint)."""
        state = dict(state)
        for family, effect in self._velocity.items():
            state[family], u = effect.apply(values[family], state[family], u, signals)
        return state, u

    @property
    def learns_from_errors(self) -> bool:
        """Whether an effect's state follows what the model gets wrong."""
        return any(effect.learns_from_errors for effect in self._velocity.values())

    def corrected(
        self, values: ChainValues, state: ChainState, error: jax.Array, displacement: jax.Array
    ) -> ChainState:
        """States after a step was measured; arguments as of `VelocityEffect.corrected`."""
        state = dict(state)
        for family, effect in self._velocity.items():
            state[family] = effect.corrected(values[family], state[family], error, displacement)
        return state

    def nominal_velocity(
        self, values: ChainValues, state: ChainState, v: jax.Array, signals: Signals
    ) -> tuple[ChainState, jax.Array]:
        """One inverse step: a measured velocity to the nominal machine's, (..., n_joint)."""
        state = dict(state)
        for family, effect in reversed(self._velocity.items()):
            state[family], v = effect.invert(values[family], state[family], v, signals)
        return state, v

    def command_sequence(self, values: ChainValues, command: jax.Array) -> jax.Array:
        """`commands` along a whole log from rest: (T, ..., n_joint)."""
        for family, effect in self._command.items():
            command = along(
                partial(effect.apply, values[family]), effect.initial(command.shape[1:-1]), command
            )
        return command

    def velocity_sequence(
        self, values: ChainValues, u: jax.Array, signals: Signals
    ) -> tuple[jax.Array, jax.Array]:
        """`velocity` and `ahead` along a whole log from rest: (T, ..., n_joint), or a zero for the latter.

        Computed effect by effect, which is equivalent.
        """
        ahead = jnp.asarray(0.0)
        for family, effect in self._velocity.items():
            step = partial(_moved, effect, values[family])
            u, of_effect = along(step, effect.initial(u.shape[1:-1]), u, signals)
            ahead = ahead if of_effect is None else ahead + of_effect
        return u, ahead

    def ahead(self, values: ChainValues, state: ChainState) -> jax.Array:
        """How far the frozen model's joints lie ahead of the true configuration, (..., n_joint), or a zero."""
        found = [effect.ahead(values[family], state[family]) for family, effect in self._velocity.items()]
        return sum((of_effect for of_effect in found if of_effect is not None), start=jnp.asarray(0.0))

    def measured(self, values: ChainValues, q: jax.Array) -> jax.Array:
        """True to measured configuration, (..., n_joint)."""
        for family, effect in self._sensor.items():
            q = effect.measured(values[family], q)
        return q

    def true(self, values: ChainValues, q: jax.Array) -> jax.Array:
        """Measured to true configuration."""
        for family, effect in reversed(self._sensor.items()):
            q = effect.true(values[family], q)
        return q

    def sensor_scale(self, values: ChainValues, q: jax.Array) -> jax.Array:
        """Measured per true displacement, (..., n_joint): a derivative, so that neutral values give exactly one."""
        return jax.jvp(lambda q: self.measured(values, q), (q,), (jnp.ones_like(q),))[1]


def _moved(
    effect: VelocityEffect, values: Values, state: Any, u: jax.Array, signals: Signals
) -> tuple[Any, tuple[jax.Array, jax.Array | None]]:
    state, v = effect.apply(values, state, u, signals)
    return state, (v, effect.ahead(values, state))


def along(step: Callable[..., tuple[Any, Any]], state: Any, *rows: Any) -> Any:
    """Run a step along the rows' first axis; vectorised if the step is stateless."""
    if not jax.tree.leaves(state):
        return step(state, *rows)[1]
    return jax.lax.scan(lambda state, row: step(state, *row), state, rows)[1]


def set_in(values: ChainValues, neutral: NeutralValues, share: Mapping[str, jax.Array]) -> ChainValues:
    """Values of effects scaled by `share`, (..., n_joint) in [0, 1], the part that has set in.

    Families missing in `share` act in full.
    """
    return {
        family: {
            name: jnp.asarray(neutral[family][name])
            + _expanded(share[family], np.ndim(value)) * (value - neutral[family][name])
            for name, value in of_family.items()
        }
        if family in share
        else of_family
        for family, of_family in values.items()
    }


def _expanded(share: jax.Array, n_axes: int) -> jax.Array:
    """Expand (..., n_joint) to the axes of a value, whose first axis is the joint's."""
    return share.reshape(*share.shape, *([1] * (n_axes - 1)))
