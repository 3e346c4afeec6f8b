"""Expected evidence, against normal distributions written out in full, and what a plan is chosen of."""

import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.nominal.noise import Noise
from pipeline.discrepancy.experiment.choose import choose
from pipeline.discrepancy.experiment.evidence import PairSums, log_error_bound, pair_sums
from pipeline.discrepancy.experiment.manoeuvres import Manoeuvre

RANDOM = np.random.default_rng(0)
N_ROWS = 40
NOISE = Noise(np.array([0.1, 0.2]), np.array([0.01, 0.02]), np.array([1.0, 3.0]), np.array([0.03, 0.05]))


def log_ratio(difference: np.ndarray, deviations: np.ndarray, columns: np.ndarray) -> float:
    """Expected log-likelihood ratio of two normals of one covariance, (N,), (N,), (N, P): half the distance squared."""
    covariance = np.diag(deviations**2) + columns @ columns.T
    return 0.5 * float(difference @ np.linalg.inv(covariance) @ difference)


def test_evidence_is_the_expected_log_likelihood_ratio_of_the_two_predictions() -> None:
    true = 0.5 + RANDOM.normal(size=(N_ROWS, 2))
    rival = true + 0.3 * RANDOM.normal(size=(N_ROWS, 2))
    column = RANDOM.normal(size=(N_ROWS, 2))
    found = pair_sums(true, rival, [column], np.ones((N_ROWS, 2), bool), NOISE).evidence()

    mean = lambda of: (of[::2] + of[1::2]) / 2  # noqa: E731
    moves = np.maximum(abs(mean(true)), abs(mean(rival))) > NOISE.standing
    deviation = np.where(moves, NOISE.moving, NOISE.standing) * np.sqrt(NOISE.correlated)
    repeated = [mean(true) * NOISE.unrepeated * (np.arange(2) == joint) for joint in range(2)]
    columns = np.stack([of.ravel() for of in (mean(column), *repeated)], axis=1)
    assert found == pytest.approx(log_ratio(mean(true - rival).ravel(), deviation.ravel(), columns))


def test_a_rival_that_can_adapt_its_values_is_not_told_apart() -> None:
    true = np.abs(RANDOM.normal(size=(N_ROWS, 2))) + 1.0
    rival = 0.9 * true
    known = np.ones((N_ROWS, 2), bool)
    stiff = pair_sums(true, rival, [], known, NOISE).evidence()
    soft = pair_sums(true, rival, [10.0 * true], known, NOISE).evidence()
    assert soft < 0.02 * stiff
    assert (
        pair_sums(true, rival, [], ~known, NOISE).evidence() == 0.0
    )  # what nominal logs do not show says nothing


def test_sums_add_up_over_manoeuvres() -> None:
    known = np.ones((N_ROWS, 2), bool)
    true, rival, column = (RANDOM.normal(size=(2, N_ROWS, 2)) for _ in range(3))
    parts = [pair_sums(true[k], rival[k], [column[k]], known, NOISE) for k in range(2)]
    whole = pair_sums(
        *(of.reshape(-1, 2) for of in (true, rival)), [column.reshape(-1, 2)], np.tile(known, (2, 1)), NOISE
    )
    assert parts[0].plus(parts[1]).evidence() == pytest.approx(whole.evidence())


def sums(*evidence: float) -> list[PairSums]:
    return [PairSums(2.0 * of, np.zeros(1), np.zeros((1, 1))) for of in evidence]


def manoeuvre(seconds: float, q: float = 0.0) -> Manoeuvre:
    return Manoeuvre("move", np.array([q]), [(np.ones(1), seconds)])


def test_the_bound_on_errors_is_that_of_the_worst_pairs() -> None:
    assert log_error_bound(sums(8.0, 400.0)) == pytest.approx(-2.0)
    assert log_error_bound(sums(8.0, 8.0)) == pytest.approx(np.log(2.0) - 2.0)


def test_what_tells_the_least_told_pair_apart_comes_first_and_the_time_is_kept() -> None:
    manoeuvres = [manoeuvre(4.0), manoeuvre(4.0), manoeuvre(30.0), manoeuvre(4.0)]
    of = {0: sums(30.0, 0.1), 1: sums(0.1, 30.0), 2: sums(900.0, 900.0), 3: sums(1e-6, 1e-6)}
    assert sorted(choose(manoeuvres, of, np.ones(1), 20.0, 2)) == [0, 1]  # 2 is too long, 3 tells nothing
    assert len(choose(manoeuvres, of, np.ones(1), 10.0, 2)) == 1
    assert choose(manoeuvres, {}, np.ones(1), 20.0, 2) == []


def test_the_way_to_another_place_takes_its_time() -> None:
    manoeuvres = [manoeuvre(4.0), manoeuvre(4.0, q=3.0), manoeuvre(4.0)]
    of = {0: sums(9.0), 1: sums(8.0), 2: sums(8.0)}
    assert choose(manoeuvres, of, np.ones(1), 10.0, 1) == [0, 2]
