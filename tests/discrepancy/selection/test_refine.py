"""Gauss-Newton on the residuals of machines whose velocities are known functions of the values."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows, averaged
from pipeline.discrepancy.diagnosis.simulation import Hypothesis
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.refine import parameter_covariance, refine
from pipeline.discrepancy.selection.regression import Folds
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.effects.effect import Parameter

N_ROWS = 400
FAMILY = "of_the_test"


def machine(velocity_of, measured: np.ndarray, parameters: list[Parameter]):
    """One joint with `velocity_of` (values of all parameters -> (T,)), and the rows that it is fitted to."""
    neutral = {p.name: np.full(1, p.neutral) for p in parameters}
    effect = SimpleNamespace(
        of_the_machine=(),
        sizes=lambda _: np.ones(1),
        card=SimpleNamespace(parameters=tuple(parameters)),
        neutral=lambda: {name: value.copy() for name, value in neutral.items()},
        reaches_other_joints=False,
    )

    def velocities(hypotheses):
        return np.stack(
            [
                velocity_of(*(v[0] for v in (h.values.get(FAMILY) or neutral).values()))[None, :, None]
                for h in hypotheses
            ]
        )

    simulation = SimpleNamespace(
        effects={FAMILY: effect},
        sequences=SimpleNamespace(velocity=measured[None, :, None]),
        velocities=velocities,
    )
    n = N_ROWS // 2
    rows = ScoredRows(
        np.ones((1, N_ROWS), bool),
        Folds(np.zeros(n, int), np.arange(n) // 10, n // 10),
        np.ones(1),
        np.ones((n, 1)),
    )
    return simulation, rows


def candidate(freed: tuple[str, ...], values: list[float]) -> Candidate:
    variant = tuple(((name, None),) for name in freed)
    return Candidate(FAMILY, 0, None, {}, variant, np.array(values), 0.0, 0.0, np.zeros(1))


def test_a_step_that_is_too_long_is_followed_by_a_shorter_one() -> None:
    drive = np.sin(0.21 * np.arange(N_ROWS))
    # Newton's step from 0.3 leads to the far side, where the error is larger: the curve is flat where it begins.
    simulation, rows = machine(
        lambda c: np.arctan(20.0 * c) * drive, np.zeros(N_ROWS), [Parameter("c", "1", 0.0, -2.0, 2.0)]
    )
    (found,) = refine(simulation, rows, [SelectedEffect(candidate(("c",), [0.3]))])
    assert abs(found.candidate.coefficients[0]) < 1e-3


@pytest.mark.parametrize("start", [(0.0, 0.0), (0.5, -0.2)])
def test_a_value_at_its_bound_does_not_keep_the_others_where_they_are(start) -> None:
    row = np.arange(N_ROWS)
    first = np.sin(0.21 * row)
    columns = np.stack([first, first + 0.3 * np.sin(0.47 * row)], axis=1)
    measured = columns @ np.array([1.5, -0.4])  # the first lies beyond its bound
    simulation, rows = machine(
        lambda a, b: columns @ np.array([a, b]),
        measured,
        [Parameter("a", "1", 0.0, -0.5, 0.5), Parameter("b", "1", 0.0, -2.0, 2.0)],
    )
    (found,) = refine(simulation, rows, [SelectedEffect(candidate(("a", "b"), list(start)))])
    seen = averaged(columns[None], rows.is_used), averaged(measured[None], rows.is_used)
    expected = lsq_linear(*seen, bounds=([-0.5, -2.0], [0.5, 2.0])).x
    assert expected[0] == pytest.approx(0.5)
    assert found.candidate.coefficients == pytest.approx(expected, abs=2e-3)


def test_what_joints_have_in_common_is_one_value_and_known_better_than_by_each() -> None:
    """Two joints that drift with one time constant, fitted by hand: by least squares over both at once."""
    simulation, rows, model = drifting_pair()
    starts = [
        Candidate(
            FAMILY, joint, None, {"t": start}, ((("c", None),),), np.array([0.1]), gain, 0.5, np.zeros(1)
        )
        for joint, start, gain in ((0, 30.0, 1.0), (1, 90.0, 3.0))
    ]
    refined = [of.candidate for of in refine(simulation, rows, [SelectedEffect(c) for c in starts])]
    expected = least_squares(model, [60.0, 0.1, 0.1], x_scale=[10.0, 0.1, 0.1]).x
    assert refined[0].point["t"] == refined[1].point["t"] == pytest.approx(expected[0], rel=2e-3)
    assert [c.coefficients[0] for c in refined] == pytest.approx(expected[1:], abs=2e-3)
    covariance = parameter_covariance(simulation, rows, [SelectedEffect(c) for c in refined])
    of_both = [of[[c.name for c in coordinates].index("t")] for coordinates, of in covariance.values()]
    alone = parameter_covariance(simulation, rows, [SelectedEffect(refined[0])])[0][1][0, 0]
    assert of_both[0][0] == pytest.approx(of_both[1][0])
    assert of_both[0][0] < alone


def drifting_pair():
    """Joints of different noise floors that are slower by c e^{-t / T}, and their residuals by (T, c, c)."""
    row = np.arange(N_ROWS)
    drive = np.stack([np.sin(0.21 * row), np.sin(0.13 * row + 1.0)], axis=1)
    floor = np.array([0.02, 0.005])
    noise = np.random.default_rng(4).normal(size=drive.shape) * np.sqrt(2.0 * floor) * 0.3
    true = drive * (1.0 - np.array([0.3, 0.2]) * np.exp(-row / 60.0)[:, None]) + noise
    effect = SimpleNamespace(
        card=SimpleNamespace(
            parameters=(
                Parameter("c", "1", 0.0, -2.0, 2.0),
                Parameter("t", "s", 50.0, 5.0, 500.0, grid=(50.0,)),
            )
        ),
        of_the_machine=("t",),
        sizes=lambda _: np.ones(2),
        neutral=lambda: {"c": np.zeros(2), "t": np.full(2, 50.0)},
        reaches_other_joints=False,
    )

    def velocities(hypotheses):
        values = [h.values.get(FAMILY) or effect.neutral() for h in hypotheses]
        return np.stack([(drive * (1.0 - v["c"] * np.exp(-row[:, None] / v["t"])))[None] for v in values])

    n = N_ROWS // 2
    folds = Folds(np.zeros(n, int), np.arange(n) // 10, n // 10)
    rows = ScoredRows(np.ones((1, N_ROWS), bool), folds, floor, np.ones((n, 2)))
    simulation = SimpleNamespace(
        effects={FAMILY: effect},
        sequences=SimpleNamespace(velocity=true[None]),
        velocities=velocities,
    )

    def residuals(values: np.ndarray) -> np.ndarray:
        known = {"c": np.array(values[1:]), "t": np.full(2, values[0])}
        left = rows.averaged(true[None] - velocities([Hypothesis({FAMILY: known})])[0])
        return (left / np.sqrt(floor)).ravel()

    return simulation, rows, residuals
