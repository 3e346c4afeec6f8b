"""Effects of a model are the same effects in a search, and their values a prior of its fit."""

from typing import Any

import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.simulation import NOMINAL
from pipeline.discrepancy.selection.candidate import with_candidate
from pipeline.discrepancy.selection.known.known_effects import known_effects
from pipeline.discrepancy.selection.known.what_is_left import Left, what_is_left
from pipeline.discrepancy.selection.linear_parameters import freed_of
from pipeline.discrepancy.selection.refine import parameter_covariance, refine
from pipeline.discrepancy.selection.selected_effect import Known, SelectedEffect, hypothesis_of
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.dependence import Dependence
from pipeline.effects.effect import Parameter
from pipeline.effects.store import ActiveEffects
from tests.discrepancy.bare_candidate import bare_candidate
from tests.discrepancy.exact_machine import N_JOINT, SETTING, STEP_NS, held_commands, simulation_of
from tests.discrepancy.selection.test_refine import N_ROWS, candidate, machine

COMMAND = held_commands(0, 400)


@pytest.mark.parametrize("family", list(KNOWN))
def test_every_effect_of_a_model_is_the_same_in_the_search(family: str) -> None:
    channels = {"oil": np.arange(400.0), "pressure": np.arange(400.0) % 7.0}
    simulation = simulation_of([family], COMMAND, COMMAND, channels)
    setting, effect = simulation.setting, simulation.effects[family]
    is_of_source = isinstance(effect, Dependence) and effect.per_source
    for variant in (
        [freed_of(effect, int(is_of_source))] if isinstance(effect, Dependence) else effect.variants()
    ):
        for point in (effect.grid() or [{}])[:2]:
            bare = bare_candidate(family, 0)
            values = 0.1 + 0.01 * np.arange(len(variant))
            sought = type(bare)(**{**vars(bare), "point": point, "freed": variant, "coefficients": values})
            expected = with_candidate(simulation, NOMINAL, sought).values
            deviations = {
                family: {name: 0.3 * np.ones_like(value) for name, value in expected[family].items()}
            }
            (found,) = known_effects(
                ActiveEffects(setting, expected, {}, deviations), simulation, np.full(N_JOINT, 2.0)
            )
            assert (found.candidate.family, found.candidate.joint) == (family, 0)
            assert found.candidate.source == (1 if is_of_source else None)
            assert len(found.candidate.coefficients) == len(variant)
            again = hypothesis_of(simulation, [found]).values
            for name, value in expected[family].items():
                np.testing.assert_array_equal(again[family][name], value)
            assert found.known is not None and set(found.known.deviations.values()) == {0.3}


@pytest.mark.parametrize(("onset", "expected"), [(-STEP_NS, None), (100 * STEP_NS, 100 * STEP_NS)])
def test_what_set_in_before_these_logs_acts_all_the_time_in_them(onset: int, expected: int | None) -> None:
    simulation = simulation_of(["gain"], COMMAND, COMMAND)
    values = {**KNOWN["gain"](SETTING).neutral(), "ratio_positive": np.array([0.7, 1.0])}
    given = ActiveEffects(SETTING, {"gain": values}, {"gain": {0: onset}})
    (found,) = known_effects(given, simulation, np.ones(N_JOINT))
    assert found.candidate.onset == expected
    assert found.known is not None and found.known.candidate.onset == onset


def test_the_fit_weighs_a_prior_and_rows_by_their_variances() -> None:
    """The value that is most probable, and its variance, of a linear model with a normal prior, in closed form."""
    random, correlated = np.random.default_rng(3), 4.0
    drive = np.sin(0.21 * np.arange(N_ROWS))
    measured = 0.5 * drive + random.standard_normal(N_ROWS)
    simulation, rows = machine(lambda c: c * drive, measured, [Parameter("c", "1", 0.0, -2.0, 2.0)])
    before, deviation = 0.2, 0.15
    known = Known(candidate(("c",), [before]), {"coefficient:0": deviation}, correlated)
    (found,) = refine(simulation, rows, [SelectedEffect(candidate(("c",), [before]), known=known)])
    x, y = (rows.averaged(of[None, :, None])[:, 0] for of in (drive, measured))
    of_rows = (x @ x) / correlated  # so many rows count as one
    expected = (x @ y / correlated + before / deviation**2) / (of_rows + 1.0 / deviation**2)
    assert found.candidate.coefficients[0] == pytest.approx(expected, abs=1e-3)
    ((_, covariance),) = parameter_covariance(simulation, rows, [found]).values()
    assert covariance[0, 0] < min(deviation**2, 1.0 / of_rows)


@pytest.mark.parametrize(
    ("size", "drives", "expected"),
    [(0.7, True, Left.there), (0.0, True, Left.gone), (0.0, False, Left.unseen)],
)
def test_what_logs_do_not_show_is_not_gone(size: float, drives: bool, expected: Left) -> None:
    drive = np.sin(0.21 * np.arange(N_ROWS)) if drives else np.zeros(N_ROWS)
    measured = size * drive + 0.05 * np.random.default_rng(3).standard_normal(N_ROWS)
    simulation, rows = machine(lambda c: c * drive, measured, [Parameter("c", "1", 0.0, -2.0, 2.0)])
    effect: Any = SelectedEffect(candidate(("c",), [0.7]), known=Known(candidate(("c",), [0.7])))
    assert what_is_left(simulation, rows, [effect], effect, lambda _: size > 0.0) is expected
