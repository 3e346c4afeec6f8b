"""Where an experiment is planned though nothing was told: joints that hardly moved, and those of refused effects."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.simulation import NOMINAL
from pipeline.discrepancy.experiment.explanations import Explanation, Freedom
from pipeline.discrepancy.experiment.plan_experiment import joints_in_doubt
from pipeline.discrepancy.experiment.predictions import STEP, at_every_value
from pipeline.discrepancy.selection.selected_effect import Known, SelectedEffect
from tests.discrepancy.bare_candidate import bare_candidate

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
