"""Term selection finds known polynomial systems; the predictor follows them."""

import numpy as np
import pytest

from pipeline.dynamics.evaluation.errors import prediction_errors
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.references.forward_regression import select_terms
from pipeline.dynamics.references.narx import NarxConfig, fit_narx
from pipeline.errors import InputError
from tests.dynamics.conftest import lag_trajectory, make_trajectory, random_trajectory

DT_S = 0.05


def config(**changes) -> NarxConfig:
    values = {
        "target": Target.dq,
        "motion_lags": [0],
        "command_lags": [0, 1, 2],
        "maximum_terms": 8,
        "maximum_rows": 20_000,
        "simulation_horizon": 20,
    }
    return NarxConfig(**(values | changes))


def benchmark(n_rows: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """y(k) = 0.2 y(k-1) + 0.1 y(k-1) u(k-1) + 0.9 u(k-2): the example of SysIdentPy's documentation."""
    u, y = np.random.default_rng(seed).uniform(-1, 1, n_rows), np.zeros(n_rows)
    for k in range(2, n_rows):
        y[k] = 0.2 * y[k - 1] + 0.1 * y[k - 1] * u[k - 1] + 0.9 * u[k - 2]
    return y, u


def selected(candidates: np.ndarray, y: np.ndarray, maximum_terms: int = 10):
    return select_terms(candidates.T @ candidates, candidates.T @ y, float(y @ y), len(y), maximum_terms)


def test_benchmark_terms_and_their_error_reduction_ratios():
    y, u = benchmark(40_000)
    columns = {"1": np.ones(len(y) - 3)}
    columns |= {f"y{lag}": y[3 - lag : len(y) - lag] for lag in (1, 2)}
    columns |= {f"u{lag}": u[3 - lag : len(u) - lag] for lag in (1, 2, 3)}
    names = [(a, b) for i, a in enumerate(columns) for b in list(columns)[i:]]
    candidates = np.stack([columns[a] * columns[b] for a, b in names], axis=1)
    found = selected(candidates, y[3:])
    assert [names[term] for term in found.terms] == [("1", "u2"), ("1", "y1"), ("y1", "u1")]
    # Shares of the output's variance; u is white and of variance 1/3.
    expected = [1 - 0.2**2 - 0.1**2 / 3, 0.2**2, 0.1**2 / 3]
    np.testing.assert_allclose(found.error_reduction_ratios, expected, rtol=0.05)
    coefficients = np.linalg.lstsq(candidates[:, found.terms], y[3:])[0]
    np.testing.assert_allclose(coefficients, [0.9, 0.2, 0.1], atol=1e-9)


def test_selection_equals_regression_on_every_candidate_in_turn():
    """Against the definition: at each step the candidate that lowers the residual sum of squares most."""
    random = np.random.default_rng(1)
    candidates = random.normal(size=(300, 12)) @ random.normal(size=(12, 12))
    y = candidates[:, [2, 5, 7]] @ [1.0, -2.0, 0.7] + 0.5 * random.normal(size=300)
    found = selected(candidates, y)
    terms: list[int] = []
    for term, ratio in zip(found.terms, found.error_reduction_ratios, strict=True):
        left = {i: residual(candidates, y, [*terms, i]) for i in range(12) if i not in terms}
        assert min(left, key=left.__getitem__) == term
        assert ratio == pytest.approx((residual(candidates, y, terms) - left[term]) / (y @ y), rel=1e-6)
        terms.append(term)
    criterion = [300 * np.log(residual(candidates, y, terms) / (y @ y)) + len(terms) * np.log(300)]
    criterion.append(
        300 * np.log(residual(candidates, y, terms[:-1]) / (y @ y)) + (len(terms) - 1) * np.log(300)
    )
    assert criterion[0] < criterion[1]


def residual(candidates: np.ndarray, y: np.ndarray, terms: list[int]) -> float:
    fitted = candidates[:, terms] @ np.linalg.lstsq(candidates[:, terms], y)[0] if terms else 0.0
    return float(np.sum((y - fitted) ** 2))


def test_noise_and_copies_are_not_selected():
    random = np.random.default_rng(2)
    x = random.normal(size=(2000, 5))
    x[:, 3] = 2 * x[:, 1]  # a copy explains nothing more
    found = selected(x, 3 * x[:, 1] + random.normal(size=2000))
    assert len(found.terms) == 1 and found.terms[0] in (1, 3)
    assert len(selected(x, np.zeros(2000)).terms) == 0


def test_narx_recovers_the_benchmark_from_a_log():
    y, u = benchmark(3000)
    log = make_trajectory(np.stack([y, -y], axis=1), np.zeros((3000, 2)), np.stack([u, u], axis=1))
    narx = fit_narx([log], config(), DT_S)
    names = narx.term_names(["left", "right"])
    first = {name: value for name, value in zip(names, narx.coefficients[:, 0], strict=True) if value != 0}
    # The displacement: y(k+1) - y(k). Both joints' variables are candidates, and the same but for sign.
    assert len(first) == 3
    found = {name.replace("right", "left"): abs(value) for name, value in first.items()}
    expected = {"q_left[t]": 0.8, "a_left[t-1]": 0.9, "a_left[t] q_left[t]": 0.1}
    assert found == pytest.approx(expected, abs=1e-6)
    errors = prediction_errors(narx, [make_log(*benchmark(400, seed=5))])
    assert errors.open_loop_rmse_80.max() < 1e-9


def make_log(y, u):
    return make_trajectory(np.stack([y, -y], axis=1), np.zeros((len(y), 2)), np.stack([u, u], axis=1))


@pytest.mark.parametrize("target", list(Target))
def test_linear_system_is_predicted_exactly(target):
    logs = [lag_trajectory(seed, n_rows=1000, n_validation=0) for seed in (0, 1)]
    narx = fit_narx(logs, config(target=target), DT_S)
    errors = prediction_errors(narx, [lag_trajectory(7, n_rows=500, n_validation=0)])
    assert errors.open_loop_rmse_80.max() < 1e-9
    assert np.count_nonzero(narx.coefficients, axis=0).tolist() == [2, 2]  # own motion and own late command


def test_fewer_terms_are_kept_where_more_diverge():
    """Noise makes many terms pay one step ahead; simulations decide."""
    random = np.random.default_rng(3)
    clean = lag_trajectory(0, n_rows=1500, n_validation=0)
    noisy = make_trajectory(clean.q + 0.004 * random.normal(size=clean.q.shape), clean.qd, clean.a)
    narx = fit_narx([noisy], config(motion_lags=[0, 1, 2], maximum_terms=40), DT_S)
    errors = prediction_errors(narx, [lag_trajectory(7, n_rows=500, n_validation=0)])
    assert errors.open_loop_rmse_80.max() < 0.2  # the joints move by 1.2


def test_only_training_rows_count_and_rows_are_thinned():
    log = lag_trajectory(0, n_rows=600, n_validation=200)
    spoiled = make_trajectory(
        np.where(np.arange(600)[:, None] < 400, log.q, 7.0), log.qd, log.a, n_validation=200
    )
    first, second = (fit_narx([x], config(maximum_rows=150), DT_S) for x in (log, spoiled))
    np.testing.assert_array_equal(first.coefficients, second.coefficients)


def test_mistakes_are_named():
    with pytest.raises(InputError, match=r"judge.narx.motion_lags is \[-1\]"):
        config(motion_lags=[-1])
    with pytest.raises(InputError, match="4 training rows in a row"):
        fit_narx([random_trajectory(0, n_rows=3)], config(), DT_S)
