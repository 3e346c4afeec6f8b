"""A given model along logs: against its own rollouts, in which positions are those that it predicts itself."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.diagnosis_model import DiagnosisModel
from pipeline.discrepancy.diagnosis.given_model import GivenModel
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.fir.model import FirModel
from tests.dynamics.conftest import make_fir_specification, make_specification, move_biases

N_ROWS, DT_S = 60, 0.05


def model_of(kind: str) -> DynamicsModel:
    if kind == "nfir":
        return FirModel(make_fir_specification(1.0, np.array([0.4, 0.6]), lags=5))
    return DynamicsModel(make_specification("mlp", kind))


def commands_of(model: DynamicsModel) -> np.ndarray:
    held = np.random.default_rng(0).choice([-1.0, 0.0, 1.0], (N_ROWS // 5, len(model.specification.joints)))
    return np.repeat(held, 5, axis=0).astype(np.float32)


@pytest.mark.parametrize("kind", ["dq", "dqdot", "nfir"])
def test_where_a_model_goes_by_itself_it_moves_as_in_its_rollout(kind: str) -> None:
    model = model_of(kind)
    parameters = move_biases(model.initialise(jax.random.key(0)))
    command = commands_of(model)
    first = model.initial_history(jnp.zeros(command.shape[1]))
    q = np.concatenate([first.q[None], model.roll_out(parameters, first, jnp.asarray(command))])
    nobody: Any = None  # stops are not asked for
    velocity = GivenModel(model, parameters, nobody).velocity(command[None], q[None, :-1])
    np.testing.assert_allclose(velocity[0], np.diff(q, axis=0) / DT_S, atol=2e-4)
    assert np.abs(np.diff(q, axis=0)).max() > 1e-4  # it does move


def test_of_the_diagnosis_models_kind_it_is_that_model() -> None:
    model = model_of("nfir")
    parameters = model.initialise(jax.random.key(1))
    command = commands_of(model)
    q = np.cumsum(np.random.default_rng(1).normal(0.0, 1e-3, command.shape), axis=0).astype(np.float32)
    identified = DiagnosisModel(model, parameters, np.zeros((1, 1, 1), bool))
    given = GivenModel(model, parameters, identified)
    expected = identified.velocity(command[None], q[None])
    np.testing.assert_allclose(given.velocity(command[None], q[None]), expected, atol=1e-4)
    np.testing.assert_array_equal(given.members_velocity(command, q)[0], given.velocity(command, q))
