"""Stops that rows of logs show, of a joint that moves as it is told and ends where it is said to."""

import numpy as np
import pytest

from pipeline.dynamics.model.shown_motion import Shown

LIMIT, SPEED, DT_S = 1.0, 0.5, 0.05


def driven_up(begin: float, end: float, dead_rows: int) -> np.ndarray:
    """(N,) positions under a full command: at rest for some rows, then up to the end, where the joint stays."""
    moving = begin + SPEED * DT_S * np.maximum(np.arange(60) - dead_rows, 0)
    return np.minimum(moving, end)


def shown(*runs: np.ndarray) -> Shown:
    q = np.concatenate([run[:-1] for run in runs])[:, None]
    velocity = np.concatenate([np.diff(run) for run in runs])[:, None] / DT_S
    return Shown(np.ones_like(q), q, velocity)


@pytest.mark.parametrize(
    ("runs", "stop"),
    [
        ([driven_up(0.0, 0.985, 0)], 0.985),  # stands a little within its stated limit
        ([driven_up(0.0, 5.0, 0)], np.inf),  # goes beyond it
        ([driven_up(0.0, 0.5, 0)], LIMIT),  # never comes near
        ([driven_up(0.965, 0.99, 12)[:15]] * 12, LIMIT),  # is late near it, then goes on
    ],
)
def test_a_stop_is_where_a_joint_ends(runs, stop):
    rows = shown(*runs)
    _, upper = rows.stops(np.array([-LIMIT]), np.array([LIMIT]), np.array([SPEED]))
    np.testing.assert_allclose(upper, [stop])
