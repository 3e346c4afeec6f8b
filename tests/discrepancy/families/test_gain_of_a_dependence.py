"""A gain and a dependence with a reference, on one joint, are the dependence: with the same speeds as both together."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.discrepancy.families.gain_of_a_dependence import doubted_by_what_varies, with_its_gain
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, hypothesis_of
from tests.discrepancy.bare_candidate import bare_candidate
from tests.discrepancy.exact_machine import SPEED, held_commands, simulation_of

POSITION = "other:position"
POSITIVE, NEGATIVE = ("ratio_positive", None), ("ratio_negative", None)


def gain(joint: int = 0, changes: tuple[float, float] = (-0.2, 0.1)) -> Candidate:
    return replace(
        bare_candidate("gain", joint), freed=((POSITIVE,), (NEGATIVE,)), coefficients=np.array(changes)
    )


def position(joint: int = 0, source: int = 1) -> Candidate:
    freed = tuple(
        (("coefficients", (direction, source, basis)),) for direction in range(2) for basis in range(6)
    )
    coefficients = np.array([0.3, -0.1, 0.2, 0.1, 0.0, 0.0, 0.0, 0.1, -0.2, 0.2, 0.3, 0.4])
    return replace(bare_candidate(POSITION, joint), source=source, freed=freed, coefficients=coefficients)


def test_they_move_the_machine_as_both_did() -> None:
    command = held_commands(3, 610)[:601]
    simulation = simulation_of(["gain", POSITION], command, SPEED * command)
    simulation._rows[1] = simulation._rows[1] + np.linspace(-1.0, 1.0, 601)[:, None, None]  # all places
    both = [SelectedEffect(gain()), SelectedEffect(position())]
    together = with_its_gain(both)
    assert [f.candidate.family for f in together] == [POSITION]
    expected, told = (
        simulation.velocities([hypothesis_of(simulation, found)])[0] for found in (both, together)
    )
    # Between two knots the product of both is not linear: at the knots they agree.
    at_knots = np.arange(0, 601, 100)
    assert np.ptp(expected[0, :, 0] / np.where(command[:, 0] == 0.0, 1.0, command[:, 0])) > 0.1
    np.testing.assert_allclose(told[0, at_knots], expected[0, at_knots], atol=2e-3)
    assert together[0].losers[-1][0].family == "gain"


def test_directions_that_change_alike_come_as_one_coefficient() -> None:
    alike = replace(gain(), freed=((POSITIVE, NEGATIVE),), coefficients=np.array([-0.25]))
    (together,) = with_its_gain([SelectedEffect(alike), SelectedEffect(position())])
    values = dict(zip(together.candidate.freed, together.candidate.coefficients, strict=True))
    for direction in range(2):
        assert values[(("coefficients", (direction, 1, 6)),)] == pytest.approx(-0.25)


@pytest.mark.parametrize(
    "beside",
    [position(joint=1, source=0), bare_candidate("other:velocity", 0), bare_candidate("delay", 0)],
    ids=["another joint's", "without a reference", "a name"],
)
def test_any_other_gain_stays(beside: Candidate) -> None:
    found = [SelectedEffect(gain()), SelectedEffect(beside)]
    assert with_its_gain(found) == found


def test_a_gain_that_sets_in_stays() -> None:
    found = [SelectedEffect(replace(gain(), onset=5)), SelectedEffect(position())]
    assert with_its_gain(found) == found


def test_the_mean_of_a_course_that_was_as_good_is_none() -> None:
    course, beside = (
        bare_candidate("other:absolute_time", 0, width=6.0),
        bare_candidate("other:absolute_time", 0, width=3.0),
    )
    assert [
        f.candidate for f in with_its_gain([SelectedEffect(gain(), [course]), SelectedEffect(beside)])
    ] == [course]
    worse = [SelectedEffect(gain()), SelectedEffect(beside)]
    assert with_its_gain(worse) == worse


@pytest.mark.parametrize("family", ["other:absolute_time", "supply_variation"])
def test_a_gain_beside_a_variation_that_is_not_borne_out_is_not_certain(family: str) -> None:
    course = bare_candidate("other:absolute_time", 0, width=6.0)
    one, elsewhere = SelectedEffect(gain()), SelectedEffect(gain(joint=1))
    varying = SelectedEffect(bare_candidate(family, 0, width=3.0))
    doubted = doubted_by_what_varies([one, elsewhere], [one, elsewhere, varying], [course])
    assert [f.equivalents for f in doubted] == [[course], []]
    assert doubted_by_what_varies([one, varying], [one, varying], [course]) == [one, varying]


def test_a_common_change_that_is_borne_out_elsewhere_casts_no_doubt() -> None:
    one, supply = SelectedEffect(gain()), "supply_variation"
    here, elsewhere = (SelectedEffect(bare_candidate(supply, joint, width=3.0)) for joint in (0, 1))
    passed = [one, elsewhere]
    assert doubted_by_what_varies(passed, [one, here, elsewhere], []) == passed
