"""One joint's own course in time against speeds whose course is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import NOMINAL
from pipeline.discrepancy.families.time_varying_gain import beyond_constants, course_candidates
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.regression import Folds

N_ROWS, DT_S, NOISE = 12000, 0.05, 0.1
TIME_S = DT_S * np.arange(N_ROWS)


def logs(
    change: np.ndarray, noise_width_s: float = 0.0, seed: int = 0, u: np.ndarray | None = None
) -> tuple[SimpleNamespace, ScoredRows]:
    """Two joints in moves of a second; the first one's speed is changed by that share, the second keeps its own."""
    random = np.random.default_rng(seed)
    if u is None:
        u = random.integers(-1, 2, size=(N_ROWS // 20, 2)).repeat(20, axis=0)[None].astype(float)
    noise = random.standard_normal(u.shape)
    if noise_width_s:
        noise = gaussian_filter1d(noise, noise_width_s / DT_S, axis=1)
    noise *= NOISE / noise.std()
    velocity = u * (1.0 + change[:, None] * np.array([1.0, 0.0])) + noise
    simulation = SimpleNamespace(
        sequences=SimpleNamespace(velocity=velocity),
        velocities=lambda hypotheses: np.stack([u] * len(hypotheses)),
        setting=SimpleNamespace(dt_s=DT_S, n_joint=2),
    )
    return simulation, rows_of(np.ones((1, N_ROWS), bool))


def rows_of(is_used: np.ndarray) -> ScoredRows:
    n = int(is_used.sum()) // 2
    block = np.arange(n) // 100
    folds = Folds(block % 2, block, int(block.max(initial=0)) + 1)
    return ScoredRows(is_used, folds, np.full(2, NOISE**2), np.ones((n, 2)))


@pytest.mark.parametrize("period_s", [30.0, 60.0])
def test_a_cycle_of_the_clock_is_seen_on_its_joint_alone(period_s):
    simulation, rows = logs(-0.3 * (TIME_S % period_s < period_s / 2))
    first, second = course_candidates(simulation, NOMINAL, rows)
    assert first.share > 0.6  # of a square wave, whose edges no smooth course follows
    assert first.point["period"] == pytest.approx(period_s, rel=0.02)
    assert abs(second.share) < 0.02
    assert beyond_a_constant(simulation, rows, first) > 0.6
    assert beyond_a_constant(simulation, rows, second) < 0.02


def test_a_cycle_is_followed_over_its_edges_by_all_its_rounds():
    simulation, rows = logs(-0.3 * (TIME_S % 37.0 < 18.5))
    before = np.sum(
        rows.averaged(simulation.sequences.velocity - simulation.velocities([NOMINAL])[0])[:, 0] ** 2
    )
    left = []
    for shape in ({"width": 3.0}, {"width": 6.0}, course_candidates(simulation, NOMINAL, rows)[0].point):
        left.append(np.sum(beyond_constants(simulation, NOMINAL, rows, rows, 0, shape)[1] ** 2) / before)
    assert left[-1] < 0.7 * min(left[:-1])


def test_what_is_slower_all_the_time_has_no_course():
    simulation, rows = logs(np.full(N_ROWS, -0.2))
    first = course_candidates(simulation, NOMINAL, rows)[0]
    assert first.share > 0.5  # it has a mean, which a gain explains as well
    assert beyond_a_constant(simulation, rows, first) < 0.02


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("constant", [-0.2, 0.0])
def test_what_does_not_vary_does_not_come_round(constant, seed):
    simulation, rows = logs(np.full(N_ROWS, constant), seed=seed)
    assert not any("period" in c.point for c in course_candidates(simulation, NOMINAL, rows))


def test_a_cycle_of_the_clock_is_seen_beside_a_slow_change():
    simulation, rows = logs(-0.3 * (TIME_S % 45.0 < 22.5) - 0.15 * TIME_S / TIME_S[-1])
    assert course_candidates(simulation, NOMINAL, rows)[0].point["period"] == pytest.approx(45.0, rel=0.02)


@pytest.mark.parametrize("jitter", [0.0, 0.03])
def test_work_that_comes_round_is_no_clock(jitter):
    """What depends on where in a round of work the machine is, depends on poses or commands, which come round, too."""
    random = np.random.default_rng(1)
    rounds = np.cumsum(20.0 * (1.0 + jitter * random.standard_normal(40)))
    number = np.searchsorted(rounds, TIME_S)
    begins, ends = np.append(0.0, rounds)[number], rounds[number]
    phase = (TIME_S - begins) / (ends - begins)
    one_round = random.integers(-1, 2, size=(20, 2)).astype(float)
    u = one_round[np.minimum((20 * phase).astype(int), 19)][None]
    simulation, rows = logs(-0.3 * (phase < 0.5), u=u)
    assert not any("period" in c.point for c in course_candidates(simulation, NOMINAL, rows))


def test_noise_that_is_alike_for_half_a_second_is_no_course():
    simulation, rows = logs(np.zeros(N_ROWS), noise_width_s=0.3)
    for candidate in course_candidates(simulation, NOMINAL, rows):
        assert candidate.share < 0.01


def test_rows_beside_tell_of_a_course_between_them():
    simulation, _ = logs(0.2 * np.sin(2 * np.pi * TIME_S / 60.0))
    is_held_out = (TIME_S % 20.0 < 4.0)[None]
    held_out, fitted, nothing = (
        rows_of(used) for used in (is_held_out, ~is_held_out, np.zeros_like(is_held_out))
    )
    left = [
        np.sum(beyond_constants(simulation, NOMINAL, held_out, beside, 0, {"width": 6.0})[1] ** 2)
        for beside in (nothing, fitted)
    ]
    before = np.sum(beyond_constants(simulation, NOMINAL, held_out, fitted, 0, {"width": 6.0})[0] ** 2)
    assert left[1] < 0.4 * before
    assert left[1] < left[0]


def test_rows_that_do_not_count_say_nothing_of_others():
    """As of more joints at once than ever before: half of the time the model is far off, and nothing counts."""
    does_count = TIME_S % 4.0 < 2.0
    simulation, rows = logs(np.where(does_count, 0.0, -0.5 * (TIME_S % 60.0 < 30.0)))
    weight = np.repeat(does_count[::2, None].astype(float), 2, axis=1)
    assert course_candidates(simulation, NOMINAL, replace(rows, weight=weight))[0].share < 0.01


def beyond_a_constant(simulation: SimpleNamespace, rows: ScoredRows, candidate: Candidate) -> float:
    """Share of the squares that a constant leaves."""
    before, after = beyond_constants(simulation, NOMINAL, rows, rows, candidate.joint, candidate.point)
    return 1.0 - float(np.sum(after**2) / np.sum(before**2))
