"""Evidence in closed form, and by Laplace's method, against dense normal densities."""

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from pipeline.discrepancy.posterior.evidence.products import Prior, Products, beside_nuisance
from pipeline.discrepancy.posterior.evidence.robust_evidence import Block, fit
from pipeline.discrepancy.posterior.evidence.term_evidence import SIZES, term_evidence
from pipeline.discrepancy.posterior.residual.columns import Term

N, NUISANCE = 60, (0, 1, 2)
WIDE = 1e3


def rows() -> tuple[np.ndarray, np.ndarray]:
    """Seven columns and a residual."""
    random = np.random.default_rng(5)
    columns = random.standard_normal((N, 7))
    return columns, columns @ np.array([0.3, 0.0, -0.2, 0.5, 0.0, 0.4, 0.0]) + random.standard_normal(N)


VARIANCE = np.array([0.2, 0.1, 0.4])


def density(columns: np.ndarray, residual: np.ndarray, effects: dict[int, tuple[float, float]]) -> float:
    """Log density of the residual with coefficients of effects, mean and deviation by column, integrated out."""
    covariance = np.eye(N) + columns[:, NUISANCE] * VARIANCE @ columns[:, NUISANCE].T
    mean = np.zeros(N)
    for column, (of, deviation) in effects.items():
        mean += of * columns[:, column]
        covariance += deviation**2 * np.outer(columns[:, column], columns[:, column])
    return float(multivariate_normal(mean, covariance).logpdf(residual))


def term(columns: tuple[int, ...], mean: float, scale: float) -> Term:
    k = len(columns)
    return Term("gain", 0, None, {}, (), columns, (mean,) * k, (scale,) * k, (-WIDE,) * k, (WIDE,) * k)


def products_of(columns: np.ndarray, residual: np.ndarray) -> Products:
    return beside_nuisance([np.column_stack([columns, residual])], np.array(NUISANCE), VARIANCE)


def test_the_evidence_of_a_term_is_the_ratio_of_densities() -> None:
    columns, residual = rows()
    found = term_evidence(products_of(columns, residual), [term((3, 4), 0.0, 0.3), term((5,), 1.0, 0.25)])
    nothing = density(columns, residual, {})
    linear = [density(columns, residual, {c: (0.0, 0.3 * size) for c in (3, 4)}) for size in SIZES]
    assert found[0] == pytest.approx(logsumexp(linear) - np.log(3.0) - nothing, abs=1e-8)
    assert found[1] == pytest.approx(density(columns, residual, {5: (1.0, 0.25)}) - nothing, abs=1e-8)


def test_the_evidence_beside_other_effects_is_the_ratio_of_densities() -> None:
    columns, residual = rows()
    prior = Prior(np.array([3]), np.array([0.2]), np.array([0.5**-2]), np.array([-WIDE]), np.array([WIDE]))
    beside = products_of(columns, residual).beside(prior)
    alone = density(columns, residual, {3: (0.2, 0.5)})
    both = density(columns, residual, {3: (0.2, 0.5), 5: (1.0, 0.25)})
    assert term_evidence(beside, [term((5,), 1.0, 0.25)])[0] == pytest.approx(both - alone, abs=1e-8)


def block(columns: np.ndarray, residual: np.ndarray, effects: list[int], degrees: float) -> Block:
    return Block(columns[:, effects], columns[:, NUISANCE] * np.sqrt(VARIANCE), residual, degrees, 1.0)


def test_with_normal_noise_laplaces_method_is_exact() -> None:
    columns, residual = rows()
    residual = 0.5 * residual  # no noisier than the noise was learned to be
    none = fit([block(columns, residual, [], 1e9)], Prior(np.zeros(0, int), *np.zeros((4, 0)))).evidence
    wide = np.full(1, WIDE)
    prior = Prior(np.array([3]), np.zeros(1), np.full(1, 0.3**-2), -wide, wide)
    with_one = fit([block(columns, residual, [3], 1e9)], prior).evidence
    expected = density(columns, residual, {3: (0.0, 0.3)}) - density(columns, residual, {})
    assert with_one - none == pytest.approx(expected, abs=1e-2)


def test_a_few_strange_rows_are_no_evidence() -> None:
    columns, residual = rows()
    strange = residual - columns[:, 3] * 0.5
    few = np.argsort(-np.abs(columns[:, 4]))[:3]
    strange[few] += 10.0 * np.sign(columns[few, 4])
    wide = np.full(1, WIDE)
    prior = Prior(np.array([4]), np.zeros(1), np.ones(1), -wide, wide)
    nothing = Prior(np.zeros(0, int), *np.zeros((4, 0)))

    def gain(degrees: float) -> float:
        with_it = fit([block(columns, strange, [4], degrees)], prior).evidence
        return with_it - fit([block(columns, strange, [], degrees)], nothing).evidence

    assert gain(4.0) < 2.0 < gain(1e9)


def test_coefficients_stay_within_their_bounds() -> None:
    columns, residual = rows()
    prior = Prior(np.array([3]), np.zeros(1), np.ones(1), np.array([-2.0]), np.array([0.1]))
    assert fit([block(columns, residual, [3], 5.0)], prior).coefficients == pytest.approx([0.1])
