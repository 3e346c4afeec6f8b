"""The selection rule against its words, candidate by candidate; the trial table; the measured inference time."""

import itertools
import math
import time

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.dynamics.evaluation.inference_time import count_parameters, time_step, unit_scale_model
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.search.selection import (
    Criterion,
    ModelCandidate,
    SelectionRule,
    best,
    explain,
    select,
    within_margin,
)
from pipeline.dynamics.search.trial_table import TrialRow, read_candidates, write_trials
from pipeline.errors import InputError
from tests.dynamics.conftest import make_training

PAPERS = [Criterion.lags, Criterion.n_parameters, Criterion.inference_time]


def candidate(trial, loss, lags=18, n_parameters=1000, time_s=1e-5) -> ModelCandidate:
    return ModelCandidate(trial, make_training(lags=lags), loss, n_parameters, time_s)


@st.composite
def searches(draw):
    """Few distinct values, so that ties are common."""
    count = draw(st.integers(1, 12))
    return [
        candidate(
            trial,
            draw(st.sampled_from([1.0, 1.01, 1.02, 1.049, 1.05, 1.06, 2.0])),
            draw(st.integers(18, 20)),
            draw(st.sampled_from([100, 200, 300])),
            draw(st.sampled_from([1e-5, 2e-5, 3e-5])),
        )
        for trial in range(count)
    ]


def brute_force(candidates, margin, prefer):
    """The rule in steps, as a person would apply it to a printed table."""
    smallest = min(c.evaluation_loss for c in candidates)
    left = [c for c in candidates if c.evaluation_loss <= smallest * (1 + margin)]
    columns = {
        "lags": lambda c: c.training.lags,
        "n_parameters": lambda c: c.n_parameters,
        "inference_time": lambda c: c.inference_time_s,
        "evaluation_loss": lambda c: c.evaluation_loss,
    }
    for name in [*(criterion.value for criterion in prefer), "evaluation_loss"]:
        least = min(columns[name](c) for c in left)
        left = [c for c in left if columns[name](c) == least]
    return left[0]


@given(
    searches(),
    st.sampled_from([0.0, 0.011, 0.055, 0.5]),
    st.sampled_from([list(order) for size in range(5) for order in itertools.permutations(Criterion, size)]),
    st.randoms(),
)
def test_selection_is_the_rule_applied_step_by_step(candidates, margin, prefer, shuffler):
    rule = SelectionRule(margin, prefer)
    shuffled = list(candidates)
    shuffler.shuffle(shuffled)
    assert select(shuffled, rule) == brute_force(candidates, margin, prefer)


@given(searches(), st.floats(0, 1))
def test_nothing_beyond_the_margin_is_selected_and_no_margin_selects_the_best(candidates, margin):
    winner = select(candidates, SelectionRule(margin, PAPERS))
    assert winner.evaluation_loss <= (1 + margin) * min(c.evaluation_loss for c in candidates)
    assert select(candidates, SelectionRule(0.0, [])) == best(candidates)
    assert best(candidates) in within_margin(candidates, SelectionRule(0.0, []))


def test_fewer_lags_count_before_size_and_size_before_time():
    candidates = [
        candidate(0, 1.00, lags=25, n_parameters=100),
        candidate(1, 1.04, lags=18, n_parameters=900, time_s=1e-5),
        candidate(2, 1.03, lags=18, n_parameters=500, time_s=3e-5),
        candidate(3, 1.02, lags=18, n_parameters=500, time_s=2e-5),
        candidate(4, 1.20, lags=18, n_parameters=1),
    ]
    rule = SelectionRule(0.05, PAPERS)
    assert select(candidates, rule).trial == 3
    said = explain(candidates[3], candidates, rule)
    assert "trial 0" in said and "2.0% worse" in said and "fewer lags (18 instead of 25)" in said
    assert "none within 0.0%" in explain(candidates[0], candidates, SelectionRule(0.0, PAPERS))


def test_a_reason_names_the_criterion_that_decided():
    rule = SelectionRule(0.1, PAPERS)
    first = candidate(0, 1.0, n_parameters=900)
    assert "fewer parameters (500 instead of 900)" in explain(
        candidate(1, 1.05, n_parameters=500), [first, candidate(1, 1.05, n_parameters=500)], rule
    )
    slower, faster = candidate(0, 1.0, time_s=3e-5), candidate(1, 1.05, time_s=2e-5)
    assert "a shorter inference time (20.0 µs instead of 30.0 µs)" in explain(faster, [slower, faster], rule)


def test_an_unmeasured_time_is_not_compared():
    with pytest.raises(ValueError, match="no inference time"):
        select([candidate(0, 1.0, time_s=math.nan)], SelectionRule(0.0, PAPERS))
    assert select([candidate(0, 1.0, time_s=math.nan)], SelectionRule(0.0, [Criterion.lags])).trial == 0


def test_a_search_without_a_complete_trial_and_a_bad_rule_are_refused():
    with pytest.raises(InputError, match="no trial"):
        select([], SelectionRule(0.0, []))
    with pytest.raises(InputError, match=r"margin is -0\.1"):
        SelectionRule(-0.1, [])
    with pytest.raises(InputError, match="list each criterion once"):
        SelectionRule(0.1, [Criterion.lags, Criterion.lags])


def row(trial, **changes) -> TrialRow:
    values = {
        "state": "complete",
        "evaluation_loss": 0.1 / 3,
        "training": make_training(hidden=[512, 128], learning_rate=1e-5),
        "seed": 0,
        "epochs": 7,
        "best_epoch": 5,
        "n_parameters": 1234,
        "seconds": 1.234,
        "attempts": 1,
        "same_as": None,
        "reason": "",
    }
    return TrialRow(trial, **(values | changes))


def test_the_table_gives_back_its_complete_trials_to_the_last_bit(tmp_path):
    path = tmp_path / "trials.csv"
    rows = [
        row(0),
        row(1, state="diverged", evaluation_loss=None, epochs=None, reason='diverged: "x", y'),
        row(2, same_as=0),
        row(3, training=make_training(hidden=[8])),
    ]
    write_trials(path, rows)
    first, second = read_candidates(path)
    assert (first.trial, second.trial) == (0, 3)
    assert first.training == rows[0].training and second.training.hidden == [8]
    assert first.evaluation_loss == rows[0].evaluation_loss and first.n_parameters == 1234


def test_a_damaged_table_names_file_and_line(tmp_path):
    path = tmp_path / "trials.csv"
    with pytest.raises(InputError, match="cannot be read"):
        read_candidates(path)
    write_trials(path, [row(0), row(1)])
    path.write_text(path.read_text().replace("1,complete,0.0", "1,complete,much"))
    with pytest.raises(InputError, match=r"trials\.csv: line 3 is not a trial"):
        read_candidates(path)
    path.write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="line 2 is not a trial"):
        read_candidates(path)


@pytest.mark.parametrize(("kind", "per_input"), [("mlp", 1), ("kan", 3)])
def test_the_timed_model_has_the_size_of_the_trained(machine, kind, per_input):
    training = make_training(hidden=[16], lags=5)
    model = unit_scale_model(machine, Parameterization(kind), Target.dqdot, training, legendre_degree=3)
    n_inputs, n_outputs = 2 * 2 * 6 + 2, 2
    assert count_parameters(model) == per_input * (n_inputs * 16 + 16 * n_outputs) + 16 + n_outputs


def test_step_time_is_that_of_a_call(machine):
    model = unit_scale_model(machine, Parameterization.mlp, Target.dq, make_training(), legendre_degree=3)

    class SlowModel:
        specification = model.specification
        initialise = staticmethod(model.initialise)
        initial_history = staticmethod(model.initial_history)

        @staticmethod
        def step(parameters, history, command):
            def wait(q):
                time.sleep(0.002)
                return np.asarray(q)

            waited = jax.pure_callback(
                wait, jax.ShapeDtypeStruct(history.q.shape, history.q.dtype), history.q
            )
            return model.step(parameters, history._replace(q=waited), command)

    measured = time_step(SlowModel(), 20)
    assert 0.002 <= measured.lower_quartile_s <= measured.median_s <= measured.upper_quartile_s < 0.2
    assert measured.n_calls == 20
    assert 0 < time_step(model, 20).median_s < measured.median_s
