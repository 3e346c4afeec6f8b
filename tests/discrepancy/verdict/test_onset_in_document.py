"""In which log an effect sets in, and when in it, by stamps alone."""

import numpy as np
import pytest

from pipeline.discrepancy.verdict.document import _onset
from pipeline.logs.tuples import Trajectory

DT_S, N_ROWS = 0.05, 1000


def log(name: str, begin_s: float) -> Trajectory:
    t_s = DT_S * np.arange(N_ROWS)
    stamp_ns = np.round(1e9 * (begin_s + t_s)).astype(np.int64)
    empty = np.zeros((N_ROWS, 1))
    return Trajectory(name, t_s, stamp_ns, empty, empty, empty, np.zeros(N_ROWS, bool))


@pytest.mark.parametrize(
    ("onset_s", "name", "t"),
    [
        (0.0, "morning", 0.0),
        (110.0, "morning", 10.0),
        (210.0, "noon", 10.0),  # also before the end of `evening`, which comes first in the folder
        (250.0, "evening", 0.0),  # between two logs: when it was seen first
        (310.01, "evening", 10.05),
    ],
)
def test_the_log_that_holds_the_moment_or_the_next_one_is_named(onset_s: float, name: str, t: float) -> None:
    measured = [log("evening", 300.0), log("noon", 200.0), log("morning", 100.0)]
    found = _onset(measured, int(1e9 * onset_s))
    assert found is not None
    assert found["trajectory"] == name
    assert found["t"] == pytest.approx(t)


def test_a_moment_after_all_logs_is_in_none_of_them() -> None:
    measured = [log("evening", 300.0)]
    assert _onset(measured, int(1e9 * 1000.0)) is None
    assert _onset(measured, None) is None
