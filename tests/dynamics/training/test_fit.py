"""Training: what it learns, when it stops, that it resumes, that seeds decide."""

import dataclasses

import jax
import numpy as np
import pytest

from pipeline.dynamics.evaluation.errors import open_loop_residuals
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.model.specify import residual_scales, velocity_limits
from pipeline.dynamics.settings import EnsembleConfig
from pipeline.dynamics.training import fit as fit_module
from pipeline.dynamics.training.checkpoint import Checkpoints
from pipeline.dynamics.training.fit import fit
from pipeline.errors import InputError
from tests.dynamics.conftest import lag_trajectory, make_identify, make_training, make_trajectory

MLP = Parameterization.mlp


def equal(first, second):
    return jax.tree.all(jax.tree.map(np.array_equal, first.parameters, second.parameters))


@pytest.mark.parametrize(("parameterization", "target"), [("mlp", "dqdot"), ("kan", "dq")])
def test_learned_model_beats_persistence_on_a_lag_system(lag_trajectories, machine, parameterization, target):
    kind = Parameterization(parameterization), Target(target)
    result = fit(lag_trajectories, machine, *kind, make_training(maximum_epochs=30), make_identify(), seed=0)
    log, starts = lag_trajectory(9, n_rows=400, n_validation=0), np.arange(40, 360, 20)
    learned = open_loop_residuals(LearnedPredictor(result.model, result.parameters), log, starts, 20)
    persistent = log.q[starts][:, None] - log.q[starts[:, None] + 1 + np.arange(20)]
    assert np.sqrt(np.mean(learned**2)) < np.sqrt(np.mean(persistent**2)) / 3


def test_returned_parameters_are_those_of_the_smallest_evaluation_loss(
    lag_trajectories, machine, monkeypatch
):
    evaluated, losses, seen = [], iter([5.0, 2.0, 4.0, 2.0]), []

    def evaluate(parameters, rows, starts):
        evaluated.append(parameters)
        return np.float32(next(losses))

    monkeypatch.setattr(fit_module, "compile_evaluation", lambda *_: evaluate)
    training = make_training(maximum_epochs=4)
    result = fit(
        lag_trajectories,
        machine,
        MLP,
        Target.dq,
        training,
        make_identify(),
        seed=0,
        progress=lambda epoch, training_loss, evaluation_loss: seen.append((epoch, evaluation_loss)),
    )
    assert seen == [(1, 5.0), (2, 2.0), (3, 4.0), (4, 2.0)]
    assert result.curves["evaluation_loss"] == [5.0, 2.0, 4.0, 2.0]
    assert (result.metrics["evaluation_loss"], result.metrics["best_epoch"]) == (2.0, 2)
    assert jax.tree.all(jax.tree.map(np.array_equal, result.parameters, evaluated[1]))


@pytest.mark.parametrize("patience", [1, 3])
def test_training_stops_after_patience_evaluations_without_improvement(
    lag_trajectories, machine, monkeypatch, patience
):
    losses = iter([5.0, 4.0, 4.0, 3.0, 6.0, 3.0, 3.5, 1.0, 2.0])
    monkeypatch.setattr(fit_module, "compile_evaluation", lambda *_: lambda *_: np.float32(next(losses)))
    result = fit(
        lag_trajectories,
        machine,
        MLP,
        Target.dq,
        make_training(maximum_epochs=9),
        make_identify(patience_evaluations=patience),
        seed=0,
    )
    # Equal is not an improvement. Patience 1 ends at the third evaluation, patience 3 at the seventh.
    assert result.metrics["epochs"] == {1: 3, 3: 7}[patience]
    assert result.metrics["best_epoch"] == {1: 2, 3: 4}[patience]


@pytest.mark.parametrize("ensemble", [None, EnsembleConfig(members=2, hidden=[4], weight_decay=0.05)])
def test_killed_run_goes_on_to_the_same_result(lag_trajectories, machine, tmp_path, ensemble):
    parameterization = MLP if ensemble is None else Parameterization.nfir
    training = make_training(maximum_epochs=5, horizon=1, batch_size=128, ensemble=ensemble)
    identify = make_identify(checkpoint_every_epochs=2)
    arguments = (lag_trajectories, machine, parameterization, Target.dqdot, training, identify, 0)
    whole = fit(*arguments)

    class Killed(Exception):
        pass

    def kill(epoch, training_loss, evaluation_loss):
        if epoch == 3:
            raise Killed

    with pytest.raises(Killed):
        fit(*arguments, progress=kill, checkpoint_directory=tmp_path)
    epochs = []
    resumed = fit(*arguments, progress=lambda epoch, *_: epochs.append(epoch), checkpoint_directory=tmp_path)
    assert epochs == [3, 4, 5]  # the checkpoint of epoch 2 was the last
    assert equal(resumed, whole)
    assert resumed.curves == whole.curves
    epochs.clear()
    assert equal(fit(*arguments, checkpoint_directory=tmp_path), whole)  # nothing left to do
    assert epochs == []


def test_a_run_never_goes_on_from_the_checkpoint_of_another(tmp_path):
    first: Checkpoints = Checkpoints(tmp_path, "first")
    first.save(1, {"x": np.ones(2, np.float32)})
    first.close()
    initial = {"x": np.zeros(2, np.float32)}
    assert Checkpoints(tmp_path, "second").restore(initial) is initial
    np.testing.assert_array_equal(Checkpoints(tmp_path, "first").restore(initial)["x"], 1.0)


def test_seed_decides_and_repeats(lag_trajectories, machine):
    def run(seed):
        training = make_training(maximum_epochs=1)
        return fit(lag_trajectories, machine, MLP, Target.dq, training, make_identify(), seed)

    assert equal(run(0), run(0))
    assert not equal(run(0), run(1))


def test_velocity_limits_are_the_training_rows_quantile():
    log = lag_trajectory(0, n_rows=400, n_validation=100)
    log.qd[300:] = 99.0  # validation rows do not count
    limits = velocity_limits([log], ["lift", "turn"], quantile=0.9)
    np.testing.assert_allclose(limits, np.quantile(np.abs(log.qd[:300]), 0.9, axis=0))


def test_residual_scale_is_the_training_rows_rms():
    log = lag_trajectory(0, n_rows=400, n_validation=100)
    expected = np.sqrt(np.mean((log.q[1:300] - log.q[:299]) ** 2, axis=0))
    np.testing.assert_allclose(residual_scales([log], Target.dq), expected)


def test_a_joint_that_never_moves_is_named():
    log = make_trajectory(np.zeros((50, 2)), np.tile([0.1, 0.0], (50, 1)), np.zeros((50, 2)))
    with pytest.raises(InputError, match="joint turn never moves"):
        velocity_limits([log], ["lift", "turn"], quantile=0.9)


def test_logs_too_short_to_train_on_are_named(machine):
    with pytest.raises(InputError, match="no trajectory has 10 training rows in a row"):
        fit(
            [lag_trajectory(0, n_rows=170, n_validation=162)],
            machine,
            MLP,
            Target.dq,
            make_training(),
            make_identify(velocity_limit_quantile=1.0),
            seed=0,
        )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"patience_evaluations": 0}, r"identify\.patience_evaluations is 0"),
        ({"gradient_clip": -1.0}, r"identify\.gradient_clip is -1\.0"),
        ({"velocity_limit_quantile": 1.5}, r"identify\.velocity_limit_quantile is 1\.5"),
    ],
)
def test_settings_out_of_range_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        dataclasses.replace(make_identify(), **change)
    with pytest.raises(InputError, match="learning_rate"):
        make_training(learning_rate=0.0)
