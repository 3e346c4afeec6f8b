"""The noise of a residual against processes whose constants are known."""

import numpy as np
import pytest

from pipeline.discrepancy.posterior.residual.noise import has_past, learn_noise
from pipeline.discrepancy.posterior.residual.rows import AT_REST, CHANGING, MOVING

N = 20_000
PHI = 0.6
SIZES = {AT_REST: 0.002, CHANGING: 0.05, MOVING: 0.02}


def drawn(degrees: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residual, state and run of a process of first order with a size per state."""
    random = np.random.default_rng(3)
    innovations = random.standard_t(degrees, N)
    innovations /= innovations.std()
    process = np.zeros(N)
    for t in range(1, N):
        process[t] = PHI * process[t - 1] + np.sqrt(1.0 - PHI**2) * innovations[t]
    state = np.repeat(random.integers(3, size=N // 50), 50)
    run = np.arange(N) // 500
    return process * np.array([SIZES[index] for index in range(3)])[state], state, run


def test_sizes_correlation_and_tails_are_those_of_the_process() -> None:
    residual, state, run = drawn(degrees=4.0)
    noise = learn_noise(residual, state, run, np.ones(N, bool), np.zeros(N))
    assert noise.size == pytest.approx([SIZES[index] for index in range(3)], rel=0.12)
    assert noise.correlation == pytest.approx([PHI, 0.0, 0.0], abs=0.05)
    assert 3.0 <= noise.degrees <= 5.0
    white = noise.whiten(residual[:, None], state, run, np.zeros(N))[has_past(run), 0]
    assert np.std(white) == pytest.approx(1.0, abs=0.02)
    assert abs(np.mean(white[1:] * white[:-1])) < 0.03


def test_normal_noise_is_told_from_heavy_tails() -> None:
    residual, state, run = drawn(degrees=1e6)
    assert learn_noise(residual, state, run, np.ones(N, bool), np.zeros(N)).degrees >= 15.0


def test_what_precedes_a_run_is_no_past() -> None:
    run = np.repeat([0, 1], 6)
    assert has_past(run).tolist() == [False] * 3 + [True] * 3 + [False] * 3 + [True] * 3


def test_each_motion_s_own_speed_is_part_of_the_noise() -> None:
    random = np.random.default_rng(5)
    velocity = np.repeat(random.uniform(0.1, 0.5, N // 40) * np.tile([1.0, -1.0], N // 80), 40)
    own = np.repeat(random.normal(0.0, 0.1, N // 40), 40)
    state, run = np.full(N, MOVING), np.arange(N) // 1000
    residual = own * velocity + random.normal(0.0, 0.01, N)
    noise = learn_noise(residual, state, run, np.ones(N, bool), velocity)
    assert noise.of_motions == pytest.approx(0.1, rel=0.25)
    # Against the covariance of one motion, written out: both are as probable.
    exactly = noise._replace(size=np.full(3, 0.01), correlation=np.zeros(3), innovation=1.0, of_motions=0.1)
    rows = slice(40, 80)
    white = exactly.whiten(residual[:, None], state, run, velocity)[rows, 0]
    covariance = 1e-4 * np.eye(40) + 0.01 * np.outer(velocity[rows], velocity[rows])
    assert white @ white == pytest.approx(residual[rows] @ np.linalg.solve(covariance, residual[rows]))


def test_a_few_motions_that_creep_are_no_measure_of_all() -> None:
    random = np.random.default_rng(6)
    velocity = np.repeat(random.uniform(0.1, 0.5, N // 40) * np.tile([1.0, -1.0], N // 80), 40)
    own = random.normal(0.0, 0.05, N // 40)
    own[::10] -= 0.8
    residual = np.repeat(own, 40) * velocity + random.normal(0.0, 0.01, N)
    noise = learn_noise(residual, np.full(N, MOVING), np.arange(N) // 1000, np.ones(N, bool), velocity)
    assert 0.04 <= noise.of_motions <= 0.1
