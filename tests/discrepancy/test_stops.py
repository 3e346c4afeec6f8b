"""Stops against motions whose readings at the stops are known by construction."""

import numpy as np
import pytest

from pipeline.discrepancy.sequences import Sequences
from pipeline.discrepancy.stops import encoders, stops

DT_S, SPEED = 0.05, 0.5
LOWER, UPPER = np.array([-1.0]), np.array([0.6])
RANGE = float(UPPER[0] - LOWER[0])
NOISE = 0.0003


def sweeps(targets, seed, at_stops=(-1.0, 0.6)) -> np.ndarray:
    """Angles of a joint that goes to one target after the other at full speed, and stands there for a second."""
    random = np.random.default_rng(seed)
    q, place = [], 0.0
    for target in targets:
        end = float(np.clip(target, *at_stops))
        n = max(2, round(abs(end - place) / (SPEED * DT_S)))
        q += [*np.linspace(place, end, n), *np.full(20, end)]
        place = end
    return np.array(q) + NOISE * random.standard_normal(len(q))


def logs(q: np.ndarray) -> Sequences:
    velocity = np.append(np.diff(q), 0.0) / DT_S
    time_s = DT_S * np.arange(len(q))
    is_row = np.arange(len(q)) < len(q) - 1
    column = (None, slice(None), None)
    zeros = np.zeros_like(q)
    return Sequences(
        zeros[column],
        q[column],
        velocity[column],
        time_s[None],
        (1e9 * time_s).astype(int)[None],
        is_row[None],
    )


def judged(before: np.ndarray, after: np.ndarray):
    speed = np.array([SPEED])
    found = [stops(logs(q), LOWER, UPPER, speed) for q in (before, after)]
    return encoders(*found, LOWER, UPPER)


INTO_BOTH = [2.0, -2.0] * 5


def test_stops_that_stay_refute_any_error_of_the_encoder() -> None:
    encoder = judged(sweeps(INTO_BOTH, 0), sweeps(INTO_BOTH[:4], 1))[0]
    assert encoder.point is None
    assert encoder.z < 1.0
    assert encoder.allows({"offset": 0.001})
    assert not encoder.allows({"offset": 0.03})
    assert not encoder.allows({"scale": 1.05})


@pytest.mark.parametrize(
    ("scale", "offset"), [(1.0, 0.08), (1.0, -0.2), (1.07, 0.0), (0.9, 0.0)], ids=lambda value: f"{value:g}"
)
def test_stops_that_move_give_offset_or_scale(scale: float, offset: float) -> None:
    encoder = judged(sweeps(INTO_BOTH, 0), scale * sweeps(INTO_BOTH, 1) + offset)[0]
    expected = {"scale": scale} if scale != 1.0 else {"offset": offset}
    assert encoder.point is not None
    assert encoder.point.keys() == expected.keys()
    for name, value in expected.items():
        assert abs(encoder.point[name] - value) < 2.0 * encoder.deviation
    assert encoder.z > 5.0


def test_play_moves_stops_inward_by_half_of_it() -> None:
    encoder = judged(sweeps(INTO_BOTH, 0), sweeps(INTO_BOTH, 1, at_stops=(-0.96, 0.56)))[0]
    assert abs(encoder.inward - 0.04) < 0.002


def test_limit_of_the_specification_stands_in_for_a_stop_not_met_before() -> None:
    inside = [0.3, -0.4, 0.25, -0.45, 0.28]
    encoder = judged(sweeps(inside, 0), sweeps(INTO_BOTH, 1) + 0.1)[0]
    assert encoder.point is not None
    assert abs(encoder.point["offset"] - 0.1) < 2.0 * encoder.deviation


def test_turning_short_of_the_stops_says_nothing() -> None:
    random = np.random.default_rng(2)
    turns = 0.4 * np.sign(np.resize([1.0, -1.0], 20)) + 0.05 * random.standard_normal(20)
    assert judged(sweeps(INTO_BOTH, 0), sweeps(turns, 3)) == {}


def test_a_joint_that_drifts_to_its_furthest_reading_has_met_no_stop() -> None:
    creep = np.concatenate([np.linspace(0.0, 0.3, 400), np.full(100, 0.3)])
    assert judged(sweeps(INTO_BOTH, 0), np.tile(np.concatenate([creep, creep[::-1]]), 4)) == {}
