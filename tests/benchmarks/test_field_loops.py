"""What the benchmark in the field counts, and the changes that it draws."""

from typing import Any

import numpy as np
import pytest

from benchmarks.closed_loop.hydraulic_plant import LARGEST_SIZE
from benchmarks.field_loops import WITH, WITHOUT, change_of, share, summary


def entry(which: str, said: list[str], certain: bool = True, **more: Any) -> dict[str, Any]:
    effects = [{"certain": certain} for _ in said]
    return {"which": which, "detected": bool(said), "said": said, "effects": effects, **more}


@pytest.mark.parametrize(
    "n, interval",
    [(0, "0 of 40 (0% to 9%)"), (40, "40 of 40 (91% to 100%)")],  # 1 - 0.025 ** (1 / 40) is 8.8 %
)
def test_the_interval_is_exact(n: int, interval: str) -> None:
    assert share(n, 40) == interval


def test_alarms_and_changes_are_counted() -> None:
    silent = [entry(WITHOUT, [])] * 7
    alarms = [entry(WITHOUT, ["delay on arm (added_delay 0.1 s)"]), entry(WITHOUT, ["lag on boom"], False)]
    change = {"kinds": ["lag"], "size": LARGEST_SIZE["lag"] / 4, "truth": ["lag on arm"]}
    changes = [
        entry(WITH, ["lag on arm"], **change, family_right=True),
        entry(WITH, ["delay on arm"], **change, family_right=False),
        entry(WITH, [], **change, family_right=False),
    ]
    told = summary([*silent, *alarms, *changes])
    assert "false alarms: 2 of 9" in told and "1 with certainty: delay 1, lag 1" in told
    assert "detected: 2 of 3" in told and "right family 1" in told
    assert told.count("| lag on arm | 25% |") == 3


def test_sizes_are_drawn_evenly_over_a_decade() -> None:
    drawn = [change_of(number) for number in range(400)]
    below = [np.log10(LARGEST_SIZE[kind] / size) for (kind,), size in drawn]
    assert min(below) >= 0.0 and max(below) <= 1.0
    assert abs(np.mean(below) - 0.5) < 0.05
    assert {kind for (kind,), _ in drawn} == set(LARGEST_SIZE)
