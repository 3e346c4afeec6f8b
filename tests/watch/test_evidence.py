"""Evidence at any time: that it holds, that it finds, and that it is the integral that it claims to be."""

import numpy as np
import pytest
from scipy.stats import t as students_t

from pipeline.watch.evidence import MOST_OF_ONE, PLACES, SCALES, SHIFTS, evidence, start_weight

N_NOMINAL, N_STATISTIC = 10, 600
NOTHING = np.full(N_STATISTIC, 1e-9)  # however small a change is, it is worth telling


@pytest.mark.parametrize("degrees", [3, 5, 1000])
def test_of_sound_machines_few_ever_alarm(degrees: int) -> None:
    """Each statistic is a machine of its own, watched at every session; heavy, right and light tails."""
    random = np.random.default_rng(degrees)
    values = random.standard_t(degrees, (N_NOMINAL + 80, N_STATISTIC))
    found = evidence(values[:N_NOMINAL], values[N_NOMINAL:], NOTHING)
    share = np.mean(found.max(axis=0) >= 20.0)
    assert share <= 0.05
    assert found.mean(axis=1).max() < 2.0  # 1 is expected at every moment


def test_a_step_is_found_within_two_sessions() -> None:
    random = np.random.default_rng(1)
    values = random.standard_normal((N_NOMINAL + 14, N_STATISTIC))
    values[-4:] += 20.0
    found = evidence(values[:N_NOMINAL], values[N_NOMINAL:], NOTHING)
    assert np.median(found[-5]) < 1.5
    assert np.mean(found[-3] >= 20.0 * 44) > 0.9  # as one of eleven statistics of four joints


def test_no_single_session_is_a_change_however_odd() -> None:
    random = np.random.default_rng(6)
    values = random.standard_normal((30, 44))
    values[15] = 1e4 * random.standard_normal(44)
    assert evidence(values[:10], values[10:], NOTHING[:44]).mean(axis=1).max() < 20.0


def test_units_do_not_matter() -> None:
    random = np.random.default_rng(2)
    values = random.standard_normal((16, 5))
    values[-2:] += 8.0
    first = evidence(values[:10], values[10:], NOTHING[:5])
    other = evidence(70.0 - 3e4 * values[:10], 70.0 - 3e4 * values[10:], NOTHING[:5])
    np.testing.assert_allclose(first, other, rtol=1e-6)


def test_changes_too_small_to_tell_are_no_evidence() -> None:
    random = np.random.default_rng(3)
    values = 1e-4 * random.standard_normal((20, 5))
    values[10:] += 4e-3  # forty standard deviations
    assert evidence(values[:10], values[10:], np.full(5, 0.03)).max() < 1.5
    assert evidence(values[:10], values[10:], np.full(5, 0.003)).min(axis=1)[-1] > 1e3


def test_sessions_that_say_nothing_leave_it_as_it_was() -> None:
    random = np.random.default_rng(4)
    values = random.standard_normal((15, 3))
    values[12:] += 10.0
    silent = np.insert(values, [11, 13], np.nan, axis=0)
    with_silent = evidence(silent[:10], silent[10:], NOTHING[:3])
    alone = evidence(values[:10], values[10:], NOTHING[:3])
    told = np.isfinite(silent[10:]).all(axis=1)
    np.testing.assert_allclose(with_silent[told], alone, rtol=1e-12)


def test_all_starts_together_weigh_one() -> None:
    n = 1_000_000
    total = start_weight(np.arange(1.0, n + 1.0)).sum()
    assert 1.0 - 101.0 / n < total <= 1.0


def test_it_is_the_ratio_of_marginal_likelihoods() -> None:
    """Summed start by start, node by node, with densities of another library."""
    random = np.random.default_rng(5)
    nominal, watched = random.standard_normal(10), np.array([0.3, -0.8, 6.0, 60.0])
    found = evidence(nominal[:, None], watched[:, None], np.array([1e-9]))[-1, 0]
    own = nominal.std(ddof=1)
    same, changed = 0.0, np.zeros(len(watched))
    for place in np.median(nominal) + own * PLACES:
        for scale in own * SCALES:
            known = students_t.pdf(nominal, 5, place, scale).prod()
            before = students_t.pdf(watched, 5, place, scale)
            same += known * before.prod()
            for shift in SHIFTS:
                wide = scale * np.sqrt(1.0 + (shift / 4.0) ** 2)
                after = students_t.pdf(watched, 5, place + shift * scale, wide)
                after = np.minimum(after, MOST_OF_ONE * before)
                for v in range(len(watched)):
                    changed[v] += known * before[:v].prod() * after[v:].prod() / len(SHIFTS)
    weight = start_weight(np.arange(1.0, 5.0))
    assert found == pytest.approx(float(weight @ changed / same + 1.0 - weight.sum()), rel=1e-9)
