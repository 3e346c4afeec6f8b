"""The exponent that solved cases ask for, on cases whose probabilities are known."""

import numpy as np
import pytest

from benchmarks.closed_loop.calibrate import EXPONENTS, STRANGE, Weighed, best_exponent, is_right, reliability
from benchmarks.closed_loop.truth import TrueEffect, Truth

TRUE_EXPONENT = 0.3


def cases(n: int) -> list[Weighed]:
    """Of three explanations each, one drawn by their probabilities at `TRUE_EXPONENT`."""
    random = np.random.default_rng(3)
    result = []
    for number in range(n):
        evidence = random.normal(0.0, 8.0, 3)
        p = np.exp(TRUE_EXPONENT * evidence)
        is_strange = random.random() < STRANGE
        right = np.arange(3) == random.choice(3, p=None if is_strange else p / p.sum())
        result.append(Weighed(("any", number), np.zeros(3), evidence, right))
    return result


def test_the_exponent_of_overconfident_evidence_is_found() -> None:
    found, (lower, upper) = best_exponent(cases(400))
    assert lower <= TRUE_EXPONENT <= upper
    assert found == pytest.approx(TRUE_EXPONENT, rel=0.3)
    assert EXPONENTS[0] < found < EXPONENTS[-1]


def test_at_that_exponent_probabilities_are_shares() -> None:
    for _, _, n, mean, share in reliability(cases(2000), TRUE_EXPONENT):
        assert abs(mean - share) < 3.0 * np.sqrt(0.25 / n) + STRANGE
    overconfident = reliability(cases(2000), 1.0)[-2]
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
