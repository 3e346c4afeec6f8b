"""An ensemble learns from logs, no member from its own part of the rows, and f learns the members' mean."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.dynamics.evaluation.errors import open_loop_rmse_80
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.fir.model import MEMBERS
from pipeline.dynamics.model.network import Parameterization, apply
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.settings import EnsembleConfig
from pipeline.dynamics.training.ensemble_loss import ensemble_loss, part_bounds
from pipeline.dynamics.training.fit import fit
from pipeline.dynamics.training.windows import gather_windows, stack_rows, window_starts
from pipeline.errors import InputError
from tests.dynamics.conftest import lag_trajectory, make_identify, make_training, move_biases

ENSEMBLE = EnsembleConfig(members=3, hidden=[8], weight_decay=0.01)
NFIR = Parameterization.nfir, Target.dqdot


@pytest.fixture(scope="module")
def fitted(lag_trajectories, machine):
    training = make_training(
        lags=12, horizon=1, learning_rate=1e-2, batch_size=128, maximum_epochs=40, ensemble=ENSEMBLE
    )
    return fit(lag_trajectories, machine, *NFIR, training, make_identify(), seed=0)


def batch(model, trajectories, n=48):
    starts = window_starts(trajectories, False, model.specification.lags + 1, 1)
    return starts, jnp.asarray(np.random.default_rng(0).permutation(starts)[:n])


def test_the_loss_is_that_of_the_rows(fitted, lag_trajectories):
    model = fitted.model
    starts, chosen = batch(model, lag_trajectories)
    bounds = part_bounds(starts, 3)
    parameters = jax.tree.map(jnp.float32, move_biases(fitted.parameters))
    window = gather_windows(model, stack_rows(lag_trajectories), chosen, 1)
    found = jax.jit(ensemble_loss(model, bounds))(parameters, window, chosen)
    q = np.asarray(window.history.q)
    commands = np.concatenate([window.history.commands[:, 1:], window.commands], axis=1)

    @jax.jit
    def velocities(q):
        inputs = model.inputs(commands, q)
        own = model.scale_residual(apply(model.network, parameters, inputs))
        return own, model.members_velocity(parameters, inputs)

    speed = np.asarray(model.specification.residual_scale)
    lower, upper = model.specification.stops()
    own, members = (np.asarray(v, np.float64) for v in velocities(q))
    elsewhere, others = (np.asarray(v, np.float64) for v in velocities(np.roll(q, 1, axis=0)))
    moved = np.clip(q + 0.05 * members, np.minimum(lower, q), np.maximum(upper, q))
    errors = np.mean(((moved - np.asarray(window.q[:, 0])) / (0.05 * speed)) ** 2, axis=-1)
    errors[np.searchsorted(bounds, np.asarray(chosen), side="right"), np.arange(len(q))] = 0.0
    gaps = np.stack([own - members.mean(axis=0), elsewhere - others.mean(axis=0)])
    assert float(found) == pytest.approx(errors.mean(axis=1).sum() + np.mean((gaps / speed) ** 2), rel=1e-4)


def test_no_member_learns_from_its_own_part(fitted, lag_trajectories):
    model = fitted.model
    starts, _ = batch(model, lag_trajectories)
    bounds = part_bounds(starts, 3)
    chosen = jnp.asarray(starts[(starts >= bounds[0]) & (starts < bounds[1])][:40])
    window = gather_windows(model, stack_rows(lag_trajectories), chosen, 1)
    gradient = jax.jit(jax.grad(ensemble_loss(model, bounds)))(fitted.parameters, window, chosen)
    moves = [
        max(float(jnp.abs(leaf[m]).max()) for leaf in jax.tree.leaves(gradient[MEMBERS])) for m in range(3)
    ]
    assert moves[1] == 0.0
    assert min(moves[0], moves[2]) > 0.0


def test_it_learns_a_machine_with_a_lag(fitted):
    """What is beyond its window, of a first-order lag of 0.2 per step, is 0.8^13 of a velocity."""
    unseen = [lag_trajectory(7, n_rows=700, n_validation=0)]
    errors, _ = open_loop_rmse_80(LearnedPredictor(fitted.model, fitted.parameters), unseen)
    still, _ = open_loop_rmse_80(
        LearnedPredictor(fitted.model, jax.tree.map(jnp.zeros_like, fitted.parameters)), unseen
    )
    assert np.all(errors < 0.15 * still)


def test_f_is_the_members_mean(fitted, lag_trajectories):
    model, trajectory = fitted.model, lag_trajectories[0]
    rows = np.arange(20, 400)[:, None] + np.arange(-12, 1)
    inputs = model.inputs(jnp.asarray(trajectory.a[rows]), jnp.asarray(trajectory.q[20:400]))
    members = model.members_velocity(fitted.parameters, inputs)
    own = model.scale_residual(apply(model.network, fitted.parameters, inputs))
    gap = np.sqrt(np.mean((own - members.mean(axis=0)) ** 2))
    assert gap < 0.1 * np.sqrt(np.mean(members**2))


@pytest.mark.parametrize(
    ("changes", "kind", "message"),
    [
        ({"ensemble": None}, NFIR, "has no ensemble"),
        ({"horizon": 4}, NFIR, "horizon is 4"),
        ({}, (Parameterization.mlp, Target.dqdot), "mlp_dqdot has an ensemble"),
    ],
)
def test_settings_of_another_kind_are_refused(changes, kind, message, lag_trajectories, machine):
    training = make_training(**({"horizon": 1, "ensemble": ENSEMBLE} | changes))
    with pytest.raises(InputError, match=message):
        fit(lag_trajectories, machine, *kind, training, make_identify(), seed=0)


def test_too_few_rows_are_refused():
    with pytest.raises(InputError, match="2 training rows are too few for an ensemble of 3"):
        part_bounds(np.array([4, 5]), 3)
