"""An augmented model as a predictor on logged rows."""

import copy
from collections.abc import Mapping
from typing import Self

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.model.stops import Stops
from pipeline.effects.augmented_model import AugmentedHistory, AugmentedModel, AugmentedParameters
from pipeline.effects.chain import Chain, ChainValues, set_in
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
        self._values = _as_values(values)
        self._parameters = parameters
        self._observe = jax.jit(self._observed)
        self._rollout = jax.jit(self._rolled_out)

    @property
    def rows_before(self) -> int:
        """Rows that must lie before a start row."""
        return self.model.specification.lags + 1

    def predict(self, trajectory: Trajectory, starts: np.ndarray, horizon: int) -> np.ndarray:
        """See `dynamics.errors.Predictor.predict`."""
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
        rows = (*columns, jnp.asarray(time_s, jnp.float32), self._channels(trajectory, padding))
        observed = self._observe(self._parameters, self._values, share, rows)
        predictions = np.empty((len(starts), horizon, trajectory.q.shape[1]))
        steps = np.arange(horizon)
        for first in range(0, len(starts), CHUNK):
            chunk = starts[first : first + CHUNK]
            padded = np.concatenate([chunk, np.full(CHUNK - len(chunk), chunk[0])])
            future = np.minimum(padded[:, None] + steps, n_rows - 1)
            predicted = self._rollout(
                self._parameters,
                self._values,
                share,
                columns[2],
                observed,
                jnp.asarray(padded),
                jnp.asarray(future),
            )
            predictions[first : first + CHUNK] = np.asarray(predicted)[: len(chunk)]
        return predictions

    def _channels(self, trajectory: Trajectory, padding: int) -> jax.Array | None:
        """(T, n_channel), NaN where the log lacks one; None: the effects look at none."""
        if not (channels := self.model.chain.setting.channels):
            return None
        unknown = np.full(len(trajectory), np.nan)
        values = np.stack([trajectory.channels.get(of.name, unknown) for of in channels], axis=-1)
        return jnp.asarray(np.pad(values, ((0, padding), (0, 0)), mode="edge"), jnp.float32)

    def with_values(self, values: Mapping[str, Mapping[str, np.ndarray]]) -> Self:
        """The same with other values of the effects; both share what is compiled."""
        other = copy.copy(self)
        other._values = _as_values(values)
        return other

    def _observed(
        self, parameters: Parameters, values: ChainValues, share: Mapping[str, jax.Array], rows: tuple
    ) -> tuple[AugmentedHistory, jax.Array]:
        """The history at each row of a log, and the true configurations, (T, n_joint)."""
        model, neutral = self.model, self.model.chain.neutral()
        q, qd, a, time_s, channels = rows
        of_first = set_in(values, neutral, {family: of[0] for family, of in share.items()})
        first = model.at_rest(AugmentedParameters(parameters, of_first), q[0])
        # An onset at a row acts on the step that starts there.
        before = jax.tree.map(_shifted, [a, time_s, channels])
        share_before = {family: _shifted(of) for family, of in share.items()}
        before[0] = before[0].at[0].set(0.0)

        def advance(history: AugmentedHistory, row: tuple) -> tuple[AugmentedHistory, AugmentedHistory]:
            q, qd, command, time_s, channels, share = row
            present = AugmentedParameters(parameters, set_in(values, neutral, share))
            history = history._replace(time_s=time_s, channels=channels)
            history = model.observe(present, history, q, qd, command)
            return history, history

        _, histories = jax.lax.scan(advance, first, (q, qd, *before, share_before))
        true = model.chain.true(set_in(values, neutral, share), q)
        return histories._replace(time_s=time_s, channels=channels), true

    def _rolled_out(
        self,
        parameters: Parameters,
        values: ChainValues,
        share: Mapping[str, jax.Array],
        commands: jax.Array,
        observed: tuple[AugmentedHistory, jax.Array],
        starts: jax.Array,
        future: jax.Array,
    ) -> jax.Array:
        model, neutral = self.model, self.model.chain.neutral()
        histories, true = observed
        history = jax.tree.map(lambda leaf: leaf[starts], histories)
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
        _, predicted = jax.lax.scan(advance, history, (jnp.moveaxis(commands[future], 1, 0), shares))
        return jnp.moveaxis(predicted, 0, 1)


def _as_values(values: Mapping[str, Mapping[str, np.ndarray]]) -> ChainValues:
    return jax.tree.map(
        lambda value: jnp.asarray(value, jnp.float32), {f: dict(of) for f, of in values.items()}
    )


def _shifted(rows: jax.Array) -> jax.Array:
    """What held before each row; the first row's own before the first."""
    return jnp.concatenate([rows[:1], rows[:-1]])


def _has_set_in(trajectory: Trajectory, onset_ns: Mapping[int, int]) -> np.ndarray:
    """Whether one family has set in, (T, n_joint) bool; always true on joints without an onset."""
    has_set_in = np.ones(trajectory.q.shape, bool)
    for joint, onset in onset_ns.items():
        has_set_in[:, joint] = trajectory.stamp_ns >= onset
    return has_set_in
