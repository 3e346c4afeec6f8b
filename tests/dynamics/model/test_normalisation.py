"""Velocity limits come from the training rows, are stored in the model, and are the same on any other log."""

import numpy as np

from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.model.store import load_model, save_model
from pipeline.dynamics.training.fit import fit
from tests.dynamics import reference
from tests.dynamics.conftest import make_identify, make_training, make_trajectory


def test_limits_are_stored_and_used_on_logs_of_other_speeds(lag_trajectories, machine, tmp_path):
    training, identify = make_training(maximum_epochs=1), make_identify(velocity_limit_quantile=0.9)
    result = fit(lag_trajectories, machine, Parameterization.mlp, Target.dqdot, training, identify, seed=0)
    rows = np.concatenate([log.qd[~log.is_validation] for log in lag_trajectories])
    limits = np.quantile(np.abs(rows), 0.9, axis=0)
    np.testing.assert_allclose(result.model.specification.velocity_limit, limits, rtol=1e-12)

    save_model(tmp_path / "model", result.model, result.parameters, {}, {}, {})
    model, parameters = load_model(tmp_path / "model")
    assert model.specification.velocity_limit == result.model.specification.velocity_limit

    log = lag_trajectories[0]
    for factor in (0.1, 10.0):
        other = make_trajectory(log.q, factor * log.qd, log.a)
        predicted = LearnedPredictor(model, parameters).predict(other, np.array([40]), horizon=3)
        expected = reference.rollout(
            result.model.specification, parameters, other.q, other.qd, other.a, 40, horizon=3
        )
        np.testing.assert_allclose(predicted[0], expected, rtol=0, atol=1e-5)
    assert model.specification.velocity_limit == result.model.specification.velocity_limit
