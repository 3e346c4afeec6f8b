"""The augmented model: f_θ with effects around it, usable like any dynamics model.

f_θ works in the coordinates of the nominal machine: its window holds the commands that reach the actuators and the
velocities (or positions) that the nominal machine would have had. Logs and policies see measured coordinates. With all
effects at neutral, both are the same, and every step equals the frozen model's.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.dynamics import Dynamics, MeasuredHistory
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.features import History, push
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.model.specification import Target
from pipeline.dynamics.model.stops import Stops
from pipeline.effects.chain import Chain, ChainState, ChainValues
from pipeline.effects.effect import Signals

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
        values: Of the effects, (..., n_joint, ...), where each history has its own; None: those of the parameters.
        channels: (..., n_channel) as last measured; in predictions on their way back to the usual. None: the effects
            look at none.
    """

    motion: jax.Array
    commands: jax.Array
    q: jax.Array
    nominal: History
    chain: ChainState
    time_s: jax.Array
    values: ChainValues | None = None
    channels: jax.Array | None = None


class AugmentedModel(Dynamics[AugmentedParameters, AugmentedHistory]):
    """A chain of effects around a frozen model; its rollouts are step by step."""

    has_hidden_state = True  # of the effects

    def __init__(self, frozen: DynamicsModel, chain: Chain) -> None:
        self.frozen = frozen
        self._free = frozen.without_own_stops()  # effects come before a stop
        self.chain = chain
        self.specification = frozen.specification

    def initial_history(self, q: jax.Array) -> AugmentedHistory:
        """History of a warm machine at rest in `q` (..., n_joint), channels as usual; all effects have set in."""
        measured = self.frozen.initial_history(q)
        batch, channels = q.shape[:-1], self.chain.setting.channels
        usual = jnp.array([channel.usual for channel in channels], q.dtype)
        return AugmentedHistory(
            *measured,
            measured,
            self.chain.initial(batch),
            jnp.full(batch, WARM_S, q.dtype),
            channels=jnp.broadcast_to(usual, (*batch, len(channels))) if channels else None,
        )

    def at_rest(self, parameters: AugmentedParameters, q: jax.Array) -> AugmentedHistory:
        """See `Dynamics.at_rest`: an encoder may read something else than where the joints are."""
        true = self.frozen.initial_history(self.chain.true(parameters.effects, q))
        return self.initial_history(q)._replace(nominal=true)

    def features(self, history: MeasuredHistory) -> jax.Array:
        """The policy's x̃_t, from measured values."""
        return self.frozen.features(history)

    def step(
        self,
        parameters: AugmentedParameters,
        history: AugmentedHistory,
        command: jax.Array,
        stops: Stops | None = None,
    ) -> AugmentedHistory:
        """See `Dynamics.step`."""
        values, dt_s = _values(parameters, history), self.specification.dt_s
        state, reaching = self.chain.commands(values, history.chain, command)
        before = history.nominal
        after = self._free.step(parameters.network, before, reaching)
        is_dq = self.specification.target is Target.dq
        u = (after.q - before.q) / dt_s if is_dq else after.motion[..., -1, :]
        signals = Signals(command, before.q, history.time_s, history.channels)
        state, v = self.chain.velocity(values, state, u, signals)
        ahead = self.chain.ahead(values, state)
        shift = dt_s * (v - u) + (ahead - self.chain.ahead(values, history.chain))
        # The window of a Δq model holds positions. A shift of the whole window keeps the nominal machine's steps.
        motion = after.motion + shift[..., None, :] if is_dq else after.motion
        drive = after.q + shift
        true = drive - ahead
        q = self.chain.measured(values, true)
        newest = q if is_dq else v * self.chain.sensor_scale(values, true)
        moved = history._replace(
            motion=push(history.motion, newest),
            commands=push(history.commands, command),
            q=q,
            nominal=History(motion, after.commands, drive),
            chain=state,
            time_s=history.time_s + dt_s,
            channels=self._later(history.channels),
        )
        for each in (self.frozen.own_stops(before.q), stops):
            moved = moved if each is None else self._stopped(values, moved, each)
        return moved

    def observe(
        self,
        parameters: AugmentedParameters,
        history: AugmentedHistory,
        q: jax.Array,
        velocity: jax.Array,
        command: jax.Array,
    ) -> AugmentedHistory:
        """See `Dynamics.observe`: the inverse chain takes what was measured to the nominal machine."""
        values, dt_s = _values(parameters, history), self.specification.dt_s
        is_dq = self.specification.target is Target.dq
        before, true = self.chain.true(values, history.q), self.chain.true(values, q)
        v = (true - before) / dt_s if is_dq else velocity / self.chain.sensor_scale(values, true)
        state, reaching = self.chain.commands(values, history.chain, command)
        if self.chain.learns_from_errors:
            predicted = self.chain.true(values, self.step(parameters, history, command).q)
            state = self.chain.corrected(values, state, true - predicted, predicted - before)
        signals = Signals(command, before, history.time_s, history.channels)
        state, u = self.chain.nominal_velocity(values, state, v, signals)
        ahead = self.chain.ahead(values, state)
        drive, motion = true + ahead, history.nominal.motion
        if is_dq:  # as in `step`
            motion = (
                motion + (dt_s * (v - u) + (ahead - self.chain.ahead(values, history.chain)))[..., None, :]
            )
        return history._replace(
            motion=push(history.motion, q if is_dq else velocity),
            commands=push(history.commands, command),
            q=q,
            nominal=History(
                push(motion, drive if is_dq else u), push(history.nominal.commands, reaching), drive
            ),
            chain=state,
            time_s=history.time_s + dt_s,
        )

    def _stopped(self, values: ChainValues, history: AugmentedHistory, stops: Stops) -> AugmentedHistory:
        """After the stops, which act on the true configuration, or on the drive, not on encoder readings."""
        target, before = self.specification.target, history.nominal
        drive, nominal_newest = stops.act(target, before.q, before.motion[..., -1, :])
        is_free = drive == before.q
        true = drive - self.chain.ahead(values, history.chain)
        q = jnp.where(is_free, history.q, self.chain.measured(values, true))
        keeps = is_free | (not stops.at_rest)
        newest = q if target is Target.dq else jnp.where(keeps, history.motion[..., -1, :], 0.0)
        return history._replace(
            motion=history.motion.at[..., -1, :].set(newest),
            q=q,
            nominal=before._replace(q=drive, motion=before.motion.at[..., -1, :].set(nominal_newest)),
        )

    def _later(self, channels: jax.Array | None) -> jax.Array | None:
        """What is expected of channels a step later."""
        if channels is None:
            return None
        usual, kept = (
            np.array([getattr(channel, name) for channel in self.chain.setting.channels], channels.dtype)
            for name in ("usual", "kept")
        )
        return channels - (channels - usual) * (1.0 - kept**self.specification.dt_s)


def _values(parameters: AugmentedParameters, history: AugmentedHistory) -> ChainValues:
    return parameters.effects if history.values is None else history.values
