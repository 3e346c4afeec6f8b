"""An augmented model as a predictor on logged rows."""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.dynamics_model import DynamicsModel, Target
from pipeline.dynamics.model.features import History
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.model.stops import Stops
from pipeline.effects.augmented_model import AugmentedHistory, AugmentedModel, AugmentedParameters
from pipeline.effects.chain import Chain, ChainState, ChainValues, set_in
from pipeline.effects.effect import Signals
from pipeline.logs.tuples import Trajectory

CHUNK = 256  # windows per call: one compilation per horizon, whatever the number of windows
ROW_QUANTUM = 1024  # logs of similar length share one compilation

Onsets = Mapping[str, Mapping[int, int]]
"""By family and index of the joint: absolute stamp, ns."""


class AugmentedPredictor:
    """Open-loop predictions of f_θ with effects, in float32; see `dynamics.errors.Predictor`.

    Args:
        model: The frozen model.
        parameters: θ.
        chain: The effects.
        values: Values of the effects, by family.
        onset_ns: Absolute stamp of the onset by family and joint index. The effect acts in full from there on; on
            joints without an onset it acts all the time.
        has_stops: See `dynamics.predictor.LearnedPredictor`.
    """

    def __init__(
        self,
        model: DynamicsModel,
        parameters: Parameters,
        chain: Chain,
        values: Mapping[str, Mapping[str, np.ndarray]],
        onset_ns: Onsets | None = None,
        has_stops: bool = True,
    ) -> None:
        self.model = AugmentedModel(model, chain)
        self.onset_ns = {family: dict(of) for family, of in (onset_ns or {}).items()}
        self._has_stops = has_stops
        self._values = jax.tree.map(
            lambda value: jnp.asarray(value, jnp.float32), {f: dict(of) for f, of in values.items()}
        )
        self._parameters = parameters
        self._observe = jax.jit(self._observed)
        self._rollout = jax.jit(self._rolled_out)

    @property
    def rows_before(self) -> int:
        """Rows that must lie before a start row."""
        return self.model.specification.lags + 1

    def predict(self, trajectory: Trajectory, starts: np.ndarray, horizon: int) -> np.ndarray:
        """See `dynamics.errors.Predictor.predict`."""
        return self.predict_with(self._values, trajectory, starts, horizon)

    def predict_with(
        self, values: ChainValues, trajectory: Trajectory, starts: np.ndarray, horizon: int
    ) -> np.ndarray:
        """`predict` with given values of the effects."""
        n_rows = -(-(len(trajectory) + 1) // ROW_QUANTUM) * ROW_QUANTUM
        padding = n_rows - len(trajectory)
        columns = [
            jnp.asarray(np.pad(column, ((0, padding), (0, 0)), mode="edge"), jnp.float32)
            for column in (trajectory.q, trajectory.qd, trajectory.a)
        ]
        time_s = np.pad(trajectory.t_s, (0, padding), mode="edge")
        share = {
            family: jnp.asarray(
                np.pad(_has_set_in(trajectory, of_joint), ((0, padding), (0, 0)), mode="edge"), jnp.float32
            )
            for family, of_joint in self.onset_ns.items()
        }
        rows = (*columns, jnp.asarray(time_s, jnp.float32))
        observed = self._observe(values, share, rows)
        predictions = np.empty((len(starts), horizon, trajectory.q.shape[1]))
        steps = np.arange(horizon)
        for first in range(0, len(starts), CHUNK):
            chunk = starts[first : first + CHUNK]
            padded = np.concatenate([chunk, np.full(CHUNK - len(chunk), chunk[0])])
            future = np.minimum(padded[:, None] + steps, n_rows - 1)
            predicted = self._rollout(
                self._parameters, values, share, rows, observed, jnp.asarray(padded), jnp.asarray(future)
            )
            predictions[first : first + CHUNK] = np.asarray(predicted)[: len(chunk)]
        return predictions

    def _observed(self, values: ChainValues, share: Mapping[str, jax.Array], rows: tuple) -> tuple:
        """True configurations, nominal velocities, commands, and the states before each row, along a log."""
        chain, dt_s = self.model.chain, self.model.specification.dt_s
        q, qd, a, time_s = rows
        neutral = chain.neutral()
        present = set_in(values, neutral, share)
        true = chain.true(present, q)
        scale = 1.0 / chain.sensor_scale(present, true) if self.model.has_sensor else 1.0
        is_dq = self.model.specification.target is Target.dq
        earlier = jnp.concatenate([true[:1], true[:-1]])
        v = (true - earlier) / dt_s if is_dq else qd * scale
        a_before = jnp.concatenate([jnp.zeros_like(a[:1]), a[:-1]])
        t_before = jnp.concatenate([time_s[:1], time_s[:-1]])
        # An onset at a row acts on the step that starts there.
        share_before = {family: jnp.concatenate([of[:1], of[:-1]]) for family, of in share.items()}

        def advance(state: ChainState, row: tuple) -> tuple[ChainState, tuple]:
            v, a_before, q_before, t_before, share = row
            present = set_in(values, neutral, share)
            state, reaching = chain.commands(present, state, a_before)
            state, u = chain.nominal_velocity(present, state, v, Signals(a_before, q_before, t_before))
            return state, (state, reaching, u)

        _, (states, reaching, u) = jax.lax.scan(
            advance, chain.initial(()), (v, a_before, earlier, t_before, share_before)
        )
        return true, v, u, reaching, states

    def _rolled_out(
        self,
        parameters: Parameters,
        values: ChainValues,
        share: Mapping[str, jax.Array],
        rows: tuple,
        observed: tuple,
        starts: jax.Array,
        future: jax.Array,
    ) -> jax.Array:
        q, qd, a, time_s = rows
        true, v, u, reaching, states = observed
        model, dt_s = self.model, self.model.specification.dt_s
        window = starts[:, None] + jnp.arange(-model.specification.lags, 1)
        is_dq = model.specification.target is Target.dq
        chain = jax.tree.map(lambda state: state[starts], states)
        ahead = model.chain.ahead(values, chain)
        if is_dq:
            # Difference of travel to the nominal machine, from each row of the window on.
            further = ((v - u) * dt_s)[window]
            nominal_motion = true[window] + (jax.lax.cumsum(further, axis=1, reverse=True) - further)
            nominal_motion = nominal_motion + (ahead[..., None, :] if ahead.ndim else ahead)
        else:
            nominal_motion = u[window]
        history = AugmentedHistory(
            motion=(q if is_dq else qd)[window],
            commands=a[window - 1],
            q=q[starts],
            nominal=History(nominal_motion, reaching[window], true[starts] + ahead),
            chain=chain,
            time_s=time_s[starts],
        )
        neutral = model.chain.neutral()
        lowest, highest = jax.lax.cummin(true)[starts], jax.lax.cummax(true)[starts]
        drive = history.nominal.q
        lowest, highest = jnp.minimum(lowest, drive), jnp.maximum(highest, drive)
        stops = Stops.of_log(model.specification, lowest, highest) if self._has_stops else None

        def advance(history: AugmentedHistory, row: tuple) -> tuple[AugmentedHistory, jax.Array]:
            command, share = row
            present = AugmentedParameters(parameters, set_in(values, neutral, share))
            history = model.step(present, history, command, stops)
            return history, history.q

        shares = {family: jnp.moveaxis(of[future], 1, 0) for family, of in share.items()}
        _, predicted = jax.lax.scan(advance, history, (jnp.moveaxis(a[future], 1, 0), shares))
        return jnp.moveaxis(predicted, 0, 1)


def _has_set_in(trajectory: Trajectory, onset_ns: Mapping[int, int]) -> np.ndarray:
    """Whether one family has set in, (T, n_joint) bool; always true on joints without an onset."""
    has_set_in = np.ones(trajectory.q.shape, bool)
    for joint, onset in onset_ns.items():
        has_set_in[:, joint] = trajectory.stamp_ns >= onset
    return has_set_in
