"""Which rows meet at rollout steps 0 and 1: in `step`, in the policy's x̃, and in the windows of training.

At step t the window holds commands up to a_t and velocities (positions) up to the newest; what is predicted is
appended as newest. The policy's x̃ holds commands up to a_{t-1}. The environment: tests/reaching.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.dynamics.model.dynamics import Dynamics
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.rollouts.open_loop import rollout
from pipeline.dynamics.training.loss import open_loop_loss
from pipeline.dynamics.training.windows import TrainingRows, gather_windows, window_starts
from tests.dynamics import reference
from tests.dynamics.conftest import LAGS, random_trajectory

T = 9


class Recorder:
    """A network that keeps what it was asked to evaluate."""

    def __init__(self, network):
        self._network = network
        self.inputs = []

    def expand(self, x):
        self.inputs.append(np.asarray(x))
        return self._network.expand(x)

    def __getattr__(self, name):
        return getattr(self._network, name)


def test_the_network_sees_the_papers_x_at_steps_0_and_1(model, parameters):
    log, specification = random_trajectory(5, n_rows=T + 3), model.specification
    motion = log.q if specification.target == "dq" else log.qd
    expected = [
        reference.approximate_state(
            specification, motion[T - LAGS : T + 1], log.a[T - LAGS : T + 1], log.q[T]
        )
    ]
    residual = reference.network(specification, parameters, expected[0])
    newest = motion[T] + residual
    q = newest if specification.target == "dq" else log.q[T] + 0.05 * newest
    expected.append(
        reference.approximate_state(
            specification, [*motion[T - LAGS + 1 : T + 1], newest], log.a[T - LAGS + 1 : T + 2], q
        )
    )
    policys = [
        reference.approximate_state(
            specification, motion[T - LAGS : T + 1], log.a[T - LAGS - 1 : T], log.q[T]
        ),
        reference.approximate_state(
            specification, [*motion[T - LAGS + 1 : T + 1], newest], log.a[T - LAGS : T + 1], q
        ),
    ]
    recording = DynamicsModel(specification)
    recording.network = recorder = Recorder(recording.network)
    with jax.enable_x64(True):
        history = model.history_from_rows(*(jnp.asarray(rows[: T + 1]) for rows in (log.q, log.qd, log.a)))
        for step in (0, 1):
            np.testing.assert_allclose(model.features(history), policys[step], rtol=0, atol=1e-13)
            history = recording.step(parameters, history, jnp.asarray(log.a[T + step]))
            np.testing.assert_allclose(recorder.inputs[step], expected[step], rtol=0, atol=1e-13)


@pytest.mark.parametrize("predict", [Dynamics.roll_out, rollout])
def test_windows_of_training_are_predicted_as_the_paper_says(model, parameters, predict):
    """Windows cut from the second of two trajectories, against the reference on its own rows."""
    logs = [random_trajectory(seed, n_rows=T + 4) for seed in (6, 7)]
    horizon, n_rows = 2, len(logs[0])
    starts = window_starts(logs, False, model.specification.lags + 1, horizon)
    start = starts[-1]
    log, t = logs[1], start - n_rows
    expected = reference.rollout(model.specification, parameters, log.q, log.qd, log.a, t, horizon)
    with jax.enable_x64(True):
        rows = TrainingRows(
            *(jnp.concatenate([getattr(log, name) for log in logs]) for name in ("q", "qd", "a"))
        )
        window = gather_windows(model, rows, jnp.asarray([start]), horizon)
        predicted = predict(model, parameters, window.history, window.commands)[0]
        loss = open_loop_loss(model, parameters, *window, jnp.ones(2))
    np.testing.assert_allclose(predicted[0], expected[0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(predicted[1], expected[1], rtol=0, atol=1e-13)
    np.testing.assert_allclose(
        loss, np.mean(np.sum((expected - log.q[t + 1 : t + 3]) ** 2, axis=1)), rtol=1e-12
    )
