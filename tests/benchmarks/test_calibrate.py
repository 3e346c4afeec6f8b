"""The exponents that solved cases ask for, on cases whose probabilities are known."""

import numpy as np
import pytest

from benchmarks.closed_loop.calibrate import STRANGE, Weighed, best_exponent, is_right, reliability
from benchmarks.closed_loop.truth import TrueEffect, Truth
from pipeline.discrepancy.posterior.probabilities import log_probabilities

OF_ANY, OF_NAMES = 0.1, 0.4


def cases(n: int) -> list[Weighed]:
    """Of no effect and three effects, one drawn by the probabilities of both exponents."""
    random = np.random.default_rng(3)
    result = []
    is_none = np.array([True, False, False, False])
    for number in range(n):
        evidence = np.append(0.0, random.normal(0.0, 12.0) + random.normal(0.0, 8.0, 3))
        p = np.exp(log_probabilities(np.zeros(4), evidence, is_none, OF_ANY, OF_NAMES))
        any_of_all = np.array([0.5, *[1 / 6] * 3])
        right = np.arange(4) == random.choice(4, p=any_of_all if random.random() < STRANGE else p)
        result.append(Weighed(("any", number), np.zeros(4), evidence, is_none, right))
    return result


def test_the_exponents_of_overconfident_evidence_are_found() -> None:
    solved = cases(300)
    found, (lower, upper) = best_exponent(solved, Weighed.score_of_any)
    assert lower <= OF_ANY <= upper
    assert found == pytest.approx(OF_ANY, rel=0.3)
    found, (lower, upper) = best_exponent(
        [case for case in solved if case.has_effect], Weighed.score_of_names
    )
    assert lower <= OF_NAMES <= upper
    assert found == pytest.approx(OF_NAMES, rel=0.3)


def test_at_these_exponents_probabilities_are_shares() -> None:
    for _, _, n, mean, share in reliability(cases(1000), OF_ANY, OF_NAMES):
        assert abs(mean - share) < 3.0 * np.sqrt(0.25 / n) + STRANGE
    overconfident = reliability(cases(1000), 1.0, 1.0)[-1]
    assert overconfident[3] > overconfident[4] + 0.1


def test_an_explanation_is_right_if_it_tells_each_effect_and_no_other() -> None:
    effect = TrueEffect("gain", None, "gain", ("boom",), (), {}, None, "", 1.0)
    truth = Truth(1, "plant", "gain", "same", 4, (effect,))
    gain = {"family": "gain", "joints": ["boom"], "sets_in": False}
    lag = {"family": "lag", "joints": ["arm"], "sets_in": False}
    assert is_right(truth, [gain])
    assert not is_right(truth, [gain, lag])
    assert not is_right(truth, [{**gain, "joints": ["arm"]}])
    assert not is_right(truth, [{**gain, "sets_in": True}])
    assert not is_right(truth, [])
    assert is_right(Truth(1, "plant", "null", "same", 4, ()), [])
