"""Shares of resamples against those that normal differences have by theory, and what has to stand beside a name."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.shares import CREDIBLE, credible, shares_of
from tests.discrepancy.bare_candidate import bare_candidate

N_BLOCKS = 400


def that_gains(family: str, by_block: np.ndarray, owed: float = 0.0) -> Candidate:
    return replace(bare_candidate(family, 0), gain=by_block.sum(), gain_by_block=by_block, owed=owed)


@pytest.mark.parametrize("z", [-1.5, 0.0, 1.0])
def test_a_share_is_how_probable_it_is_that_other_blocks_give_as_large_a_sum(z: float) -> None:
    """Of a sum that is z standard errors above the rival's."""
    difference = np.random.default_rng(5).standard_normal(N_BLOCKS)
    difference += z * difference.std() / np.sqrt(N_BLOCKS) - difference.mean()
    common = 10.0 * np.random.default_rng(6).random(N_BLOCKS)
    lag, delay = that_gains("lag", common + difference), that_gains("delay", common)
    shares = shares_of([[lag], [delay]], [1.0, 1.0])
    assert shares[lag.key] == pytest.approx(norm.cdf(z), abs=0.05)
    assert sum(shares.values()) == pytest.approx(1.0)


def test_what_is_owed_and_what_it_is_worth_count() -> None:
    even = np.full(N_BLOCKS, 1.0)
    lag, delay = that_gains("lag", 1.1 * even), that_gains("delay", even)
    assert shares_of([[lag], [delay]], [1.0, 1.0])[lag.key] > 0.99
    assert shares_of([[lag], [delay]], [0.9, 1.0])[lag.key] < 0.01
    owing = replace(lag, owed=0.2 * N_BLOCKS)
    assert shares_of([[owing], [delay]], [1.0, 1.0])[lag.key] < 0.01


def test_a_cause_of_two_joints_explains_what_it_does_on_both() -> None:
    even = np.full(N_BLOCKS, 1.0)
    gain, load = that_gains("gain", 1.5 * even), that_gains("load", even)
    elsewhere = replace(load, joint=1)
    assert shares_of([[load, elsewhere], [gain]], [1.0, 1.0])[load.key] > 0.99
    assert shares_of([[load, elsewhere], [gain]], [1.0, 2.0])[gain.key] > 0.99


def test_the_likeliest_stand_beside_a_name_until_all_are_credible() -> None:
    name, first, second, last = (("lag", joint, None) for joint in range(4))
    shares = {name: 0.6, second: 0.14, last: 0.01, first: 0.25}
    missing = credible(shares, [name])
    assert missing == [first, second]
    assert shares[name] + sum(shares[key] for key in missing) >= CREDIBLE
    assert credible(shares, [name, first, second]) == []
    assert credible({name: 0.97, first: 0.03}, [name]) == []
