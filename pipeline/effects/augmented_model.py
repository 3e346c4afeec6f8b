"""The augmented model: f_θ with effects around it, usable like any dynamics model.

f_θ works in the coordinates of the nominal machine: its window holds the commands that reach the actuators and the
velocities (or positions) that the nominal machine would have had. Logs and policies see measured coordinates. With all
effects at neutral, both are the same, and every step equals the frozen model's.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from pipeline.dynamics.model.dynamics_model import DynamicsModel, Target
from pipeline.dynamics.model.features import History, push
from pipeline.dynamics.model.network import Parameters
from pipeline.effects.chain import Chain, ChainState, ChainValues
from pipeline.effects.effect import Place, Signals

# Policies are trained for a warm machine, on which effects of warming up have faded.
WARM_S = 1800.0


class AugmentedParameters(NamedTuple):
    """Differentiable parameters of the augmented model.

    Attributes:
        network: θ of the frozen model.
        effects: Values by family.
    """

    network: Parameters
    effects: ChainValues


class AugmentedHistory(NamedTuple):
    """History before the command a_t; any leading batch axes. The first three fields are as in `History`.

    Attributes:
        motion: (..., k+1, n_joint) as measured.
        commands: (..., k+1, n_joint) as given.
        q: (..., n_joint) as measured.
        nominal: f_θ's window in nominal coordinates; its `q` is the true configuration, or with play that of the drive.
        chain: States of the effects.
        time_s: (...,) since the start of the log.
    """

    motion: jax.Array
    commands: jax.Array
    q: jax.Array
    nominal: History
    chain: ChainState
    time_s: jax.Array


class AugmentedModel:
    """Pure functions of (parameters, history, command), as in `DynamicsModel`."""

    def __init__(self, frozen: DynamicsModel, chain: Chain) -> None:
        self.frozen = frozen
        self.chain = chain
        self.specification = frozen.specification

    def initial_history(self, q: jax.Array) -> AugmentedHistory:
        """History of a warm machine that has been at rest in `q` (..., n_joint); all effects have set in."""
        measured = self.frozen.initial_history(q)
        batch = q.shape[:-1]
        return AugmentedHistory(
            *measured, measured, self.chain.initial(batch), jnp.full(batch, WARM_S, q.dtype)
        )

    def normalise_position(self, q: jax.Array) -> jax.Array:
        """As the frozen model."""
        return self.frozen.normalise_position(q)

    def features(self, history: AugmentedHistory) -> jax.Array:
        """The policy's x̃_t, from measured values."""
        return self.frozen.features(History(history.motion, history.commands, history.q))

    def step(
        self, parameters: AugmentedParameters, history: AugmentedHistory, command: jax.Array
    ) -> AugmentedHistory:
        """Advance by one time step under `command` a_t (..., n_joint)."""
        values, dt_s = parameters.effects, self.specification.dt_s
        state, reaching = self.chain.commands(values, history.chain, command)
        before = history.nominal
        after = self.frozen.step(parameters.network, before, reaching)
        is_dq = self.specification.target is Target.dq
        u = (after.q - before.q) / dt_s if is_dq else after.motion[..., -1, :]
        state, v = self.chain.velocity(values, state, u, Signals(command, before.q, history.time_s))
        ahead = self.chain.ahead(values, state)
        shift = dt_s * (v - u) + (ahead - self.chain.ahead(values, history.chain))
        # The window of a Δq model holds positions. A shift of the whole window keeps the nominal machine's steps.
        motion = after.motion + shift[..., None, :] if is_dq else after.motion
        drive = after.q + shift
        true = drive - ahead
        q = self.chain.measured(values, true)
        newest = q if is_dq else v * self.chain.sensor_scale(values, true)
        return AugmentedHistory(
            motion=push(history.motion, newest),
            commands=push(history.commands, command),
            q=q,
            nominal=History(motion, after.commands, drive),
            chain=state,
            time_s=history.time_s + dt_s,
        )

    def stopped(
        self, parameters: AugmentedParameters, history: AugmentedHistory, lower: ArrayLike, upper: ArrayLike
    ) -> AugmentedHistory:
        """End stops: a joint beyond a limit (n_joint,), rad or m, is at it, with zero velocity.

        Stops do not depend on encoder readings: they act on the true configuration, or on the drive.
        """
        nominal = self.frozen.stopped(parameters.network, history.nominal, lower, upper)
        is_free = nominal.q == history.nominal.q
        true = nominal.q - self.chain.ahead(parameters.effects, history.chain)
        q = jnp.where(is_free, history.q, self.chain.measured(parameters.effects, true))
        at_rest = q if self.specification.target is Target.dq else jnp.zeros_like(q)
        newest = jnp.where(is_free, history.motion[..., -1, :], at_rest)
        return history._replace(motion=history.motion.at[..., -1, :].set(newest), q=q, nominal=nominal)

    def between_stops(
        self, parameters: AugmentedParameters, history: AugmentedHistory, lower: ArrayLike, upper: ArrayLike
    ) -> AugmentedHistory:
        """As `stopped`, for predictions: see `DynamicsModel.between_stops`."""
        before = history.nominal
        drive, newest = self.frozen.between_stops(before.q, before.motion[..., -1, :], lower, upper)
        true = drive - self.chain.ahead(parameters.effects, history.chain)
        q = jnp.where(drive == before.q, history.q, self.chain.measured(parameters.effects, true))
        is_dq = self.specification.target is Target.dq
        return history._replace(
            motion=history.motion.at[..., -1, :].set(q) if is_dq else history.motion,
            q=q,
            nominal=before._replace(q=drive, motion=before.motion.at[..., -1, :].set(newest)),
        )

    @property
    def has_sensor(self) -> bool:
        """Whether an effect changes the measured configuration."""
        return any(effect.place is Place.sensor for effect in self.chain.effects.values())
