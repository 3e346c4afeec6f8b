"""What the machine's velocities would be if given effects were present: the diagnosis model inside the chain.

Measured configurations are fed in, velocities come out, so that nothing accumulates and every row can be compared
with what was measured there. Hypotheses of the same families share one compilation, and run side by side.
"""

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.discrepancy.diagnosis.diagnosis_model import DiagnosisModel
from pipeline.discrepancy.diagnosis.given_model import GivenModel
from pipeline.discrepancy.diagnosis.sequences import Sequences
from pipeline.effects.chain import Chain, ChainValues
from pipeline.effects.effect import Effect, SensorEffect, Setting, Signals

Values = Mapping[str, Mapping[str, np.ndarray]]  # of parameters, by family; families left out are neutral
Onsets = Mapping[tuple[str, int], int]  # by family and joint; an effect without one acts all the time
DRIVEN_AT_ONCE = 8  # the diagnosis model runs for each
RESPONDING_AT_ONCE = 32
WIDTHS = (1, 8, 32)


@dataclass(frozen=True)
class Hypothesis:
    """Effects that are present.

    Attributes:
        values: Of their parameters, by family.
        onsets: Absolute stamp [ns] from which on a family acts on a joint, by both. Those of families without values
            are ignored.
    """

    values: Values = field(default_factory=dict)
    onsets: Onsets = field(default_factory=dict)

    @property
    def moments(self) -> set[int]:
        """Stamps [ns] at which something sets in."""
        return {onset for (family, _), onset in self.onsets.items() if family in self.values}


NOMINAL = Hypothesis()  # no effect is present


class Simulation:
    """Velocities under hypotheses, on one set of logs.

    Args:
        model: The diagnosis model, or the one whose omissions are sought.
        sequences: Logs on which it runs.
        effects: Families that hypotheses may name.
        setting: Of the machine.
        left_out: (n_members, B, T) which member predicts which row, for logs that the model was trained on; None: f
            predicts all of them.
    """

    def __init__(
        self,
        model: DiagnosisModel | GivenModel,
        sequences: Sequences,
        effects: Sequence[type[Effect]],
        setting: Setting,
        left_out: np.ndarray | None = None,
    ) -> None:
        self.effects = {effect.card.family: effect(setting) for effect in effects}
        self.setting = setting
        self.sequences = sequences
        self._types = {effect.card.family: effect for effect in effects}
        self.model = model
        rows = [sequences.command, sequences.q, sequences.time_s]
        rows += [sequences.channels] if setting.channels else []
        phases = jnp.zeros(len(sequences.q))  # (B,)
        self._rows = [
            phases,
            *(jnp.asarray(np.moveaxis(of, 1, 0), jnp.float32) for of in rows),
        ]  # time in front
        # (E, T, B, 1)
        self._left_out = None if left_out is None else jnp.moveaxis(jnp.asarray(left_out)[..., None], 1, 2)
        self._compiled: dict[tuple, Callable] = {}

    def with_phases(self, phases: np.ndarray) -> "Simulation":
        """The same, where all joints of each log respond late by so many steps, in (-1, 1): (B,)."""
        late = copy.copy(self)  # what is compiled serves both
        late._rows = [jnp.asarray(phases, jnp.float32), *self._rows[1:]]
        return late

    def nominal_velocities(self, hypotheses: Sequence[Hypothesis]) -> jax.Array:
        """Velocities of the nominal machine under the commands that reach it, (n_hypotheses, T, B, n_joint)."""
        results = []
        for chunk, values, chain in self._chunks(hypotheses, DRIVEN_AT_ONCE):
            results.append(
                self._call(_driven, chain, (0, None, None), values, self._rows, self._left_out)[:chunk]
            )
        return jnp.concatenate(results)

    def velocities(self, hypotheses: Sequence[Hypothesis], u: jax.Array | None = None) -> np.ndarray:
        """Measured velocities under each hypothesis, (n_hypotheses, B, T, n_joint).

        Args:
            hypotheses: Any number.
            u: What goes into the velocity effects of all hypotheses alike (T, B, n_joint), where it is known already:
                of `nominal_velocities`, or as other effects leave it, with their onsets.
        """
        velocities = self._present(hypotheses, u)
        if u is not None:  # beside which hypotheses act all the time, but for what encoders read
            hypotheses = [self._with_onsets_of_sensors(hypothesis) for hypothesis in hypotheses]
        for moment in sorted(set().union(*(of.moments for of in hypotheses)), reverse=True):
            earlier = self._present([self._before(moment, of) for of in hypotheses], u)
            not_yet = self.sequences.stamp_ns < moment
            velocities = np.where(not_yet[..., None], earlier, velocities)
        return velocities

    def _with_onsets_of_sensors(self, hypothesis: Hypothesis) -> Hypothesis:
        sensors = {f for f in hypothesis.values if isinstance(self.effects[f], SensorEffect)}
        onsets = {key: onset for key, onset in hypothesis.onsets.items() if key[0] in sensors}
        return replace(hypothesis, onsets=onsets)

    def _before(self, moment: int, hypothesis: Hypothesis) -> Hypothesis:
        """The hypothesis without what sets in at the moment or later."""
        values = {
            family: {name: np.array(value) for name, value in of.items()}
            for family, of in hypothesis.values.items()
        }
        for (family, joint), onset in hypothesis.onsets.items():
            if family in values and onset >= moment:
                for name, neutral in self.effects[family].neutral().items():
                    values[family][name][joint] = neutral[joint]
        return Hypothesis(values)

    def _present(self, hypotheses: Sequence[Hypothesis], u: jax.Array | None) -> np.ndarray:
        results = []
        for chunk, values, chain in self._chunks(
            hypotheses, DRIVEN_AT_ONCE if u is None else RESPONDING_AT_ONCE
        ):
            if u is None:
                driven = self._call(_driven, chain, (0, None, None), values, self._rows, self._left_out)
                found = self._call(_responding, chain, (0, 0, None), values, driven, self._rows)
            else:
                found = self._call(_responding, chain, (0, None, None), values, u, self._rows)
            results.append(np.asarray(found)[:chunk])
        return np.moveaxis(np.concatenate(results), 1, 2).astype(np.float64)

    def tangents(
        self, hypotheses: Sequence[Hypothesis], directions: Sequence[Values], u: jax.Array
    ) -> Iterator[np.ndarray]:
        """Derivatives of the velocities along directions of the values; yields (B, T, n_joint) per pair.

        Args:
            hypotheses: Where, one per direction; their effects act all the time.
            directions: Values' changes; what is left out does not change.
            u: (T, B, n_joint) of `nominal_velocities`, for all hypotheses alike.
        """
        present: Values = {family: {} for d in directions for family in d}
        complete = [Hypothesis({**present, **hypothesis.values}) for hypothesis in hypotheses]
        first = 0
        for chunk, values, chain in self._chunks(complete, RESPONDING_AT_ONCE):
            still = jax.tree.map(np.zeros_like, chain.neutral())
            along = [completed(still, direction) for direction in directions[first : first + chunk]]
            along += along[-1:] * (len(jax.tree.leaves(values)[0]) - chunk)
            found = self._call(_tangent, chain, (0, 0, None, None), values, stacked(along), u, self._rows)
            first += chunk
            yield from np.moveaxis(np.asarray(found)[:chunk], 1, 2).astype(np.float64)

    def _chunks(self, hypotheses: Sequence[Hypothesis], at_once: int) -> Iterator[tuple[int, Any, Chain]]:
        """Stacked values, padded so that few shapes are compiled, and the chain for them."""
        families = tuple(family for family in self._types if any(family in of.values for of in hypotheses))
        families = families or tuple(self._types)[:1]
        chain = Chain([self._types[family] for family in families], self.setting)
        for first in range(0, len(hypotheses), at_once):
            chunk = hypotheses[first : first + at_once]
            filled = [completed(chain.neutral(), hypothesis.values) for hypothesis in chunk]
            width = next(width for width in WIDTHS if width >= len(chunk))
            yield len(chunk), stacked(filled + filled[-1:] * (width - len(chunk))), chain

    def _call(self, function: Callable, chain: Chain, axes: tuple, *arguments: Any) -> Any:
        key = (function, tuple(chain.effects), axes)
        if key not in self._compiled:
            self._compiled[key] = jax.jit(jax.vmap(partial(function, self.model, chain), in_axes=axes))
        return self._compiled[key](*arguments)


def completed(default: Values, given: Values) -> dict[str, dict[str, np.ndarray]]:
    """The values given, and the default for all others that it names."""
    return {
        family: {
            name: np.asarray(given.get(family, {}).get(name, value), np.float32) for name, value in of.items()
        }
        for family, of in default.items()
    }


def stacked(trees: Sequence) -> Any:
    """Trees of the same structure as one, with their index in front."""
    return jax.tree.map(lambda *leaves: jnp.asarray(np.stack(leaves)), *trees)


def _driven(
    model: DiagnosisModel | GivenModel,
    chain: Chain,
    values: ChainValues,
    rows: list,
    left_out: jax.Array | None,
) -> jax.Array:
    phase, command, q, *_ = rows
    reaching = jnp.moveaxis(chain.command_sequence(values, command), 0, 1)
    true = jnp.moveaxis(chain.true(values, q), 0, 1)
    if left_out is None:
        u = jnp.moveaxis(model.velocity(reaching, true), 1, 0)
    else:
        u = jnp.sum(left_out * jnp.moveaxis(model.members_velocity(reaching, true), 2, 1), axis=0)
    # A velocity is the mean over a step: late by part of a step it is made of two steps' velocities.
    earlier, later = jnp.concatenate([u[:1], u[:-1]]), jnp.concatenate([u[1:], u[-1:]])
    late = phase[:, None]
    return u + jnp.maximum(late, 0.0) * (earlier - u) + jnp.maximum(-late, 0.0) * (later - u)


def _responding(
    model: DiagnosisModel | GivenModel, chain: Chain, values: ChainValues, u: jax.Array, rows: list
) -> jax.Array:
    _, command, q, *others = rows
    true = chain.true(values, q)
    v, ahead = chain.velocity_sequence(values, u, Signals(command, true, *others))
    return model.stopped(v, true + ahead) * chain.sensor_scale(values, true)


def _tangent(
    model: DiagnosisModel | GivenModel,
    chain: Chain,
    values: ChainValues,
    direction: ChainValues,
    u: jax.Array,
    rows: list,
) -> jax.Array:
    _, tangent = jax.jvp(lambda values: _responding(model, chain, values, u, rows), (values,), (direction,))
    return tangent
