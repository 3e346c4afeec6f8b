import dataclasses

import jax
import numpy as np
import pytest

from pipeline.discrepancy.baselines.continued_training import BaselinesConfig, continue_training
from pipeline.dynamics.evaluation.errors import open_loop_rmse_80
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.errors import InputError
from tests.discrepancy.slower_machine import MACHINE, TRAINED_KINDS, make_settings, nominal, slower
from tests.dynamics.conftest import lag_trajectory

FITTED, HELD_OUT = slower(5, 600, n_validation=200), slower(6, 600)
ONE_KIND = ("mlp", "dqdot")  # for what does not depend on the kind


def tuned(kind, settings=None, logs=(FITTED,), seed=0):
    model, parameters = nominal(*kind).model, nominal(*kind).parameters
    return continue_training(model, parameters, logs, MACHINE, settings or make_settings(), seed)


def error(kind, parameters, log=HELD_OUT):
    return open_loop_rmse_80(LearnedPredictor(nominal(*kind).model, parameters), [log])[0]


@pytest.mark.parametrize("kind", TRAINED_KINDS)
def test_the_error_on_held_out_rows_of_the_changed_machine_falls(kind):
    before, after = (error(kind, p) for p in (nominal(*kind).parameters, tuned(kind)))
    assert after[0] < 0.6 * before[0]


def test_the_normalisation_and_the_given_parameters_stay():
    given = jax.tree.map(np.array, nominal(*ONE_KIND).parameters)
    specification = dataclasses.asdict(nominal(*ONE_KIND).model.specification)
    tuned(ONE_KIND)
    jax.tree.map(np.testing.assert_array_equal, given, nominal(*ONE_KIND).parameters)
    assert dataclasses.asdict(nominal(*ONE_KIND).model.specification) == specification


def test_equal_seeds_give_equal_parameters_and_others_do_not():
    first, again, other = (tuned(ONE_KIND, seed=seed) for seed in (0, 0, 1))
    jax.tree.map(np.testing.assert_array_equal, first, again)
    assert any(jax.tree.leaves(jax.tree.map(lambda a, b: bool((a != b).any()), first, other)))


def test_a_training_that_makes_the_selection_rows_worse_is_not_kept():
    """Rows to fit of a slower machine, rows to select of the machine as it was."""
    fitted, selecting = slower(5, 500), lag_trajectory(7, 300, n_validation=300)
    kept = tuned(ONE_KIND, logs=[fitted, selecting])
    assert kept is nominal(*ONE_KIND).parameters


def test_the_selection_rows_choose_the_learning_rate():
    """One rate destroys the model, the other hardly moves it: both together do as the better one alone."""
    bad, good, both = ([100.0], [2e-3], [100.0, 2e-3])
    results = [
        tuned(ONE_KIND, make_settings(learning_rates=rates, maximum_epochs=3)) for rates in (bad, good, both)
    ]
    assert results[0] is nominal(*ONE_KIND).parameters
    jax.tree.map(np.testing.assert_array_equal, results[1], results[2])


@pytest.mark.parametrize(("kind_of_rows", "n_validation"), [("fit", 300), ("select", 0)])
def test_rows_that_are_too_few_are_an_input_error(kind_of_rows, n_validation):
    with pytest.raises(InputError, match=f"rows in a row to {kind_of_rows} the baselines on"):
        tuned(ONE_KIND, logs=[slower(5, 300, n_validation=n_validation)])


@pytest.mark.parametrize(
    ("name", "value"),
    [("learning_rates", []), ("learning_rates", [1e-3, 0.0]), ("batch_size", 0), ("gradient_clip", 0.0)],
)
def test_settings_out_of_range_are_named(name, value):
    with pytest.raises(InputError, match=rf"close_loop\.baselines_budget\.{name} is"):
        BaselinesConfig(**(vars(make_settings()) | {name: value}))
