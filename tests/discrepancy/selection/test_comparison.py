"""Which of two candidates explains more, and which comes instead of which."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.comparison import Comparison
from pipeline.discrepancy.selection.regression import Folds
from pipeline.discrepancy.settings import CloseLoopConfig
from tests.discrepancy.bare_candidate import bare_candidate

N_ROWS, N_BLOCKS = 400, 4


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    """On rows of four blocks of equal length, every other one of either fold."""
    block = np.repeat(np.arange(N_BLOCKS), N_ROWS // N_BLOCKS)
    config = load_section("close_loop", CloseLoopConfig, "paper").search
    return Comparison(Folds(block % 2, block, N_BLOCKS), config)


def that_gains(family: str, gain: float, owed: float = 0.0) -> Candidate:
    """As much in every block, and half of the squares."""
    by_block = np.full(N_BLOCKS, gain / N_BLOCKS) * (1.0 + 0.01 * np.arange(N_BLOCKS))
    return replace(bare_candidate(family, 0), gain=gain, gain_by_block=by_block, owed=owed)


def test_what_is_owed_to_the_misfit_counts_for_nothing(comparison: Comparison) -> None:
    assert comparison.net(that_gains("delay", 300.0, owed=100.0)) == 200.0
    assert comparison.passes(that_gains("delay", 300.0))
    assert not comparison.passes(that_gains("delay", 300.0, owed=290.0))
    assert comparison.shows(that_gains("delay", 300.0, owed=290.0))
    assert not comparison.shows(that_gains("delay", 300.0, owed=300.0))


def test_a_dependence_gives_way_to_a_name_that_explains_as_much(comparison: Comparison) -> None:
    """The simplest name explains less than the dependence; a less simple one does not."""
    simple, dependence = that_gains("gain", 300.0), that_gains("other:position", 400.0)
    cushion = that_gains("end_cushion", 410.0)
    as_good = [simple, dependence, cushion]
    assert comparison.better_dependence(simple, as_good) is dependence
    assert comparison.names_instead(dependence, as_good) == [cushion]
    assert comparison.names_instead(dependence, [simple, dependence]) == []


def test_whatever_the_scatter_a_name_is_not_as_good_as_one_that_explains_half_as_much_again(
    comparison,
) -> None:
    by_block = np.array([0.0, 0.0, 0.0, 150.0])  # all that is more lies in one block
    better = that_gains("sensor_bias", 300.0)
    better = replace(better, gain=450.0, gain_by_block=better.gain_by_block + by_block)
    simple, dependence = that_gains("gain", 300.0), replace(better, family="other:position")
    assert comparison.is_worse(simple, better)
    assert not comparison.is_worse(that_gains("gain", 330.0), better)
    assert not comparison.is_worse(simple, dependence)


def test_a_dependence_raises_no_doubt_by_a_difference_that_decides_nothing(comparison: Comparison) -> None:
    gain = that_gains("gain", 300.0)
    assert not comparison.raises_doubt(that_gains("other:position", 303.0), gain)
    assert comparison.raises_doubt(that_gains("other:position", 306.0), gain)


def test_a_dependence_on_what_a_name_depends_on_has_to_explain_clearly_more(comparison: Comparison) -> None:
    """Of an idealised cushion it mends the form; of another joint's place it says something else."""
    cushion = that_gains("end_cushion", 300.0)
    own, elsewhere = (
        that_gains("other:position", 320.0),
        replace(that_gains("other:position", 320.0), source=1),
    )
    assert not comparison.raises_doubt(own, cushion)
    assert comparison.raises_doubt(elsewhere, cushion)
    assert comparison.better_dependence(cushion, [cushion, own]) is None
    assert comparison.better_dependence(cushion, [cushion, elsewhere]) is elsewhere
    clearly = that_gains("other:position", 340.0)
    assert comparison.raises_doubt(clearly, cushion)
    assert comparison.better_dependence(cushion, [cushion, clearly]) is clearly


def test_a_course_in_time_is_a_last_resort(comparison: Comparison) -> None:
    travel, gain = that_gains("other:travel", 300.0), that_gains("gain", 300.0)
    slightly, clearly = (that_gains("other:absolute_time", of) for of in (340.0, 400.0))
    assert comparison.simplest(comparison.as_good_as(slightly, [slightly, travel])) is travel
    assert comparison.simplest(comparison.as_good_as(clearly, [clearly, travel])) is clearly
    assert comparison.better_dependence(gain, [gain, slightly]) is None
    assert comparison.better_dependence(gain, [gain, clearly]) is clearly
    assert comparison.raises_doubt(slightly, gain)
    assert not comparison.raises_doubt(that_gains("other:absolute_time", 310.0), gain)
    # it has to explain that much more than another dependence, too, and does not make one out of its rivals
    position = that_gains("other:position", 330.0)
    assert (
        comparison.better_dependence(gain, [gain, position, that_gains("other:absolute_time", 380.0)])
        is position
    )
    assert comparison.as_good_as(slightly, [slightly, travel, that_gains("other:warmth", 200.0)]) == [
        travel,
        slightly,
    ]


def test_a_creep_has_to_stand_out_of_the_floor_at_rest_only(comparison: Comparison) -> None:
    least = comparison.config.smallest_gain * N_ROWS
    quiet = replace(comparison, at_rest=(0.1,))
    for factor, passes in [(0.05, False), (0.2, True), (1.1, True)]:
        assert quiet.passes(that_gains("leakage", factor * least)) is passes
        assert quiet.passes(that_gains("gain", factor * least)) is (factor > 1.0)
        assert comparison.passes(that_gains("leakage", factor * least)) is (factor > 1.0)
