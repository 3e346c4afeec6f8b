"""Where an experiment is planned though nothing was told: joints that hardly moved, and those of refused effects."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Hypothesis
from pipeline.discrepancy.experiment.explanations import Explanation, Freedom, left_by_logs
from pipeline.discrepancy.experiment.plan_experiment import joints_in_doubt
from pipeline.discrepancy.experiment.predictions import STEP, at_every_value
from pipeline.discrepancy.selection.selected_effect import Known, SelectedEffect
from pipeline.effects.effect import Parameter
from tests.discrepancy.bare_candidate import bare_candidate
from tests.discrepancy.selection.test_refine import FAMILY, N_ROWS, machine

NEW = SelectedEffect(bare_candidate("gain", 2))
KNOWN = SelectedEffect(NEW.candidate, known=Known(NEW.candidate))


@pytest.mark.parametrize(
    ("excited", "found", "after_none", "expected"),
    [
        ([0, 1, 2], [], False, []),
        ([0, 1, 2], [], True, [0, 1, 2]),
        ([0, 2], [], True, [1]),
        ([0, 1, 2], [NEW], False, [2]),
        ([0, 2], [NEW], False, [1, 2]),
        ([0, 1, 2], [KNOWN], False, []),
    ],
)
def test_joints_are_asked_about_that_logs_leave_in_doubt(excited, found, after_none, expected) -> None:
    config = SimpleNamespace(experiment=SimpleNamespace(after_none=after_none))
    diagnosis: Any = SimpleNamespace(
        excited=excited, logs=SimpleNamespace(joints=["a", "b", "c"], config=config)
    )
    selection: Any = SimpleNamespace(found=found)
    assert joints_in_doubt(diagnosis, selection) == expected


def test_positions_are_told_for_every_value_as_far_as_it_is_plausible() -> None:
    """Of a position that is linear in two values: the first may rise by half its deviation, the second only fall."""
    slopes, base = np.array([2.0, -3.0]), 0.5
    freedoms = (
        Freedom("gain", (), 0.4, lower=-9.0, upper=0.2),
        Freedom("lag", (), 0.1, lower=-9.0, upper=0.0),
    )
    explanation = Explanation("one", (0,), NOMINAL, freedoms)
    moved = [
        base,
        *(base + slope * of.way * STEP * of.deviation for slope, of in zip(slopes, freedoms, strict=True)),
    ]
    at = np.array(moved)[None, :, None]
    expected = [base, base - 2.0 * 0.4, base + 2.0 * 0.2, base + 3.0 * 0.1, base]
    np.testing.assert_allclose(at_every_value(at, [explanation], [0])[0, :, 0], expected)


@pytest.mark.parametrize("size", [1.0, 0.0])
def test_a_value_deviates_by_what_the_logs_leave_of_its_prior(size: float) -> None:
    """Of a velocity that is linear in its value, in closed form; rows that do not show it leave the prior."""
    drive, correlated, deviation = size * np.sin(0.21 * np.arange(N_ROWS)), 4.0, 0.3
    simulation, rows = machine(lambda c: c * drive, drive, [Parameter("c", "1", 0.0, -2.0, 2.0)])
    gate = SimpleNamespace(model_error=0.0)
    diagnosis: Any = SimpleNamespace(
        simulation=simulation, rows=rows, logs=SimpleNamespace(config=SimpleNamespace(gate=gate))
    )
    freedom = Freedom(FAMILY, (("c", (0,)),), deviation, lower=-9.0, upper=9.0)
    hypothesis = Hypothesis({FAMILY: {"c": np.array([0.5])}})
    explanation = Explanation("one", (0,), hypothesis, (freedom,))
    x = rows.averaged(drive[None, :, None])[:, 0]
    expected = 1.0 / np.sqrt(1.0 / deviation**2 + x @ x / correlated)
    assert left_by_logs(diagnosis, explanation, np.array([correlated])) == pytest.approx([expected])
