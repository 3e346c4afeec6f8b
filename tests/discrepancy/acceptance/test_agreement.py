"""Sizes of an effect in single logs: against what was put in, and how seldom chance makes them disagree."""

import numpy as np
import pytest

from pipeline.discrepancy.acceptance.agreement import Size, agree, sizes_by_log
from tests.discrepancy.coloured_noise import N, coloured

LOG, BLOCK = np.arange(N) // (N // 2), np.arange(N) // 50


def sizes(true: tuple[float, float], seed: int) -> list[Size]:
    random = np.random.default_rng(seed)
    change = coloured(random)
    return sizes_by_log(change, np.array(true)[LOG] * change + coloured(random), LOG, BLOCK)


def test_sizes_are_those_put_in_within_their_deviations() -> None:
    found = np.array([sizes((1.0, 0.2), seed) for seed in range(200)])  # (seed, log, value or deviation)
    assert found[..., 0].mean(axis=0) == pytest.approx([1.0, 0.2], abs=0.05)
    scatter = found[..., 0].std(axis=0)
    assert np.sqrt(np.mean(found[..., 1] ** 2, axis=0)) == pytest.approx(scatter, rel=0.3)


def test_an_effect_that_is_the_same_in_all_logs_seldom_disagrees_and_one_that_is_not_does() -> None:
    assert np.mean([agree(sizes((1.0, 1.0), seed), 0.5) for seed in range(100)]) > 0.98
    assert np.mean([agree(sizes((1.9, 0.1), seed), 0.5) for seed in range(100)]) < 0.35
    assert np.mean([agree(sizes((2.5, -0.5), seed), 0.5) for seed in range(100)]) < 0.02


def test_of_a_log_that_hardly_shows_the_effect_nothing_is_said() -> None:
    change = np.where(np.arange(N) < N // 2 + 30, coloured(np.random.default_rng(1)), 0.0)
    residual = np.where(np.arange(N) < N // 2, change, -change)
    assert sizes_by_log(change, residual, LOG, BLOCK) == [
        Size(pytest.approx(1.0), pytest.approx(0.0, abs=1e-9))
    ]
    assert sizes_by_log(np.zeros(N), residual, LOG, BLOCK) == []
