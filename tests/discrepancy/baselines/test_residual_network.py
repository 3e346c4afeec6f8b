import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.discrepancy.baselines.residual_network import fit_residual_network, model_with_residual
from pipeline.dynamics.evaluation.errors import open_loop_rmse_80
from pipeline.dynamics.model.network import apply
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.model.rollouts.open_loop import rollout
from tests.discrepancy.slower_machine import MACHINE, TRAINED_KINDS, make_settings, nominal, slower
from tests.dynamics import reference
from tests.dynamics.conftest import KINDS, lag_trajectory, move_biases, random_trajectory
from tests.effects.conftest import make_model
from tests.effects.conftest import random_trajectory as effects_log

T = 7


@pytest.fixture(params=TRAINED_KINDS)
def kind(request):
    return request.param


@pytest.fixture
def identified(kind):
    return nominal(*kind).model, nominal(*kind).parameters


def test_it_starts_as_the_model_itself(identified):
    model, parameters = identified
    corrected = model_with_residual(model, parameters)
    drawn = corrected.initialise(jax.random.key(1))
    x = jax.random.normal(jax.random.key(2), (50, model.specification.n_features))
    assert not np.any(apply(model.network, drawn, x))  # the residual network alone: exactly zero
    assert any(np.any(leaf) for leaf in jax.tree.leaves(drawn["layer_0"]))  # but it can learn
    log, starts = lag_trajectory(9, 300, 0), np.arange(40, 200, 7)
    frozen, started = (
        LearnedPredictor(*pair).predict(log, starts, 80) for pair in (identified, (corrected, drawn))
    )
    np.testing.assert_allclose(started, frozen, rtol=0, atol=1e-5)  # rounding of float32


def test_a_step_is_the_models_with_both_outputs_added(identified):
    """Against the paper's equations in float64 NumPy, with f + g in place of f."""
    model, parameters = identified
    specification, dt = model.specification, 0.05
    frozen, added = (move_biases(p) for p in (parameters, model.initialise(jax.random.key(5))))
    log = random_trajectory(2, n_rows=T + 2)
    window = slice(T - specification.lags, T + 1)
    is_dq = specification.target == "dq"
    x = reference.approximate_state(
        specification, (log.q if is_dq else log.qd)[window], log.a[window], log.q[T]
    )
    f, g = (reference.network(specification, p, x) for p in (frozen, added))
    expected = log.q[T] + f + g if is_dq else log.q[T] + dt * (log.qd[T] + f + g)
    with jax.enable_x64(True):
        history = model.history_from_rows(*(jnp.asarray(rows[: T + 1]) for rows in (log.q, log.qd, log.a)))
        corrected = model_with_residual(model, frozen)
        stepped = corrected.step(added, history, jnp.asarray(log.a[T]))
        rolled = rollout(corrected, added, history, jnp.asarray(log.a[T : T + 1]))
    np.testing.assert_allclose(stepped.q, expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(rolled[0], expected, rtol=0, atol=1e-13)


def test_the_error_on_held_out_rows_falls_and_the_model_stays_as_it_is(identified):
    model, parameters = identified
    given = jax.tree.map(np.array, parameters)
    specification = dataclasses.asdict(model.specification)
    fitted, held_out = slower(5, 600, n_validation=200), slower(6, 600)
    settings = make_settings(maximum_epochs=15, patience_evaluations=15)
    predictor = fit_residual_network(model, parameters, [fitted], MACHINE, settings, seed=0)
    before, after = (
        open_loop_rmse_80(one, [held_out])[0] for one in (LearnedPredictor(model, parameters), predictor)
    )
    assert after[0] < 0.6 * before[0]
    jax.tree.map(np.testing.assert_array_equal, given, parameters)
    assert dataclasses.asdict(model.specification) == specification
    assert predictor.rows_before == LearnedPredictor(model, parameters).rows_before


def test_without_improvement_on_the_selection_rows_it_is_the_model_exactly():
    model, parameters = nominal(*KINDS[0]).model, nominal(*KINDS[0]).parameters
    ruinous = make_settings(learning_rates=[100.0], maximum_epochs=2)
    logs = [slower(5, 600, n_validation=200)]
    predictor = fit_residual_network(model, parameters, logs, MACHINE, ruinous, seed=0)
    log, starts = slower(6, 300), np.arange(40, 200, 7)
    frozen, kept = (one.predict(log, starts, 80) for one in (LearnedPredictor(model, parameters), predictor))
    np.testing.assert_array_equal(kept, frozen)


def test_it_starts_as_an_nfir_model_itself():
    model = make_model("nfir")
    parameters = model.initialise(jax.random.key(0))
    corrected = model_with_residual(model, parameters)
    drawn = corrected.initialise(jax.random.key(1))
    log, starts = effects_log(1), np.array([10, 40])
    frozen, started = (
        LearnedPredictor(*pair).predict(log, starts, 20) for pair in ((model, parameters), (corrected, drawn))
    )
    np.testing.assert_allclose(started, frozen, rtol=0, atol=1e-6)
