"""Stops against motions whose readings at the stops are known by construction."""

import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.sequences import Sequences
from pipeline.discrepancy.families.stops import PUSHED_ROWS, encoders, encoders_of, stops

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


def logs(q: np.ndarray, is_pushed: bool = True) -> Sequences:
    """The command ends half a second after the joint has come to a stand or, where it is let go, some rows before."""
    motion = np.append(np.diff(q), 0.0)
    moving = np.where(np.abs(motion) > 0.2 * SPEED * DT_S, np.sign(motion), 0.0)
    command = moving.copy()
    for row in range(10, len(q)):
        if is_pushed and moving[row] == 0.0 and np.any(moving[row - 10 : row]):
            command[row] = command[row - 1]
    if not is_pushed:
        command[:-4] *= moving[4:] == moving[:-4]
    velocity = np.append(np.diff(q), 0.0) / DT_S
    time_s = DT_S * np.arange(len(q))
    is_row = np.arange(len(q)) < len(q) - 1
    column = (None, slice(None), None)
    return Sequences(
        command[column],
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
    assert encoder.errors == ()
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
    likeliest = encoder.errors[0]
    assert likeliest.point.keys() == expected.keys()
    for name, value in expected.items():
        assert abs(likeliest.point[name] - value) < 2.0 * likeliest.deviation
    assert encoder.z > 5.0


def test_play_moves_stops_inward_by_half_of_it() -> None:
    encoder = judged(sweeps(INTO_BOTH, 0), sweeps(INTO_BOTH, 1, at_stops=(-0.96, 0.56)))[0]
    assert abs(encoder.inward - 0.04) < 0.002


def test_limit_of_the_specification_stands_in_for_a_stop_not_met_before() -> None:
    inside = [0.3, -0.4, 0.25, -0.45, 0.28]
    encoder = judged(sweeps(inside, 0), sweeps(INTO_BOTH, 1) + 0.1)[0]
    likeliest = encoder.errors[0]
    assert abs(likeliest.point["offset"] - 0.1) < 2.0 * likeliest.deviation


def test_one_stop_cannot_tell_an_offset_from_a_scale() -> None:
    onto_one = [0.9, 0.1, 0.9, -0.2, 0.9, -0.1, 0.9, 0.2]
    encoder = judged(sweeps(INTO_BOTH, 0), sweeps(onto_one, 1) * 0.9)[0]
    points = {name: value for error in encoder.errors for name, value in error.point.items()}
    np.testing.assert_allclose([points["offset"], points["scale"]], [-0.06, 0.9], atol=0.003)


def test_standing_where_an_operator_lets_go_is_no_stop() -> None:
    q = sweeps([0.5, -0.9] * 5, 1)
    speed = np.array([SPEED])
    before = stops(logs(sweeps(INTO_BOTH, 0)), LOWER, UPPER, speed)
    assert encoders(before, stops(logs(q, is_pushed=False), LOWER, UPPER, speed), LOWER, UPPER) == {}
    assert encoders(before, stops(logs(q), LOWER, UPPER, speed), LOWER, UPPER)[0].z > 5.0


def test_letting_go_once_at_the_reading_of_a_stop_says_nothing_of_the_encoder() -> None:
    speed = np.array([SPEED])
    before = stops(logs(sweeps(INTO_BOTH, 0)), LOWER, UPPER, speed)
    once = sweeps([0.3, -0.4, INTO_BOTH[0], 0.2, -0.3], 1)
    assert encoders(before, stops(logs(once), LOWER, UPPER, speed), LOWER, UPPER)[0].errors == ()
    assert encoders(before, stops(logs(once, is_pushed=False), LOWER, UPPER, speed), LOWER, UPPER) == {}


@pytest.mark.parametrize(("held_rows", "is_sure"), [(PUSHED_ROWS - 15, False), (PUSHED_ROWS + 15, True)])
def test_a_stop_met_once_is_one_if_the_joint_was_held_there_for_long(held_rows: int, is_sure: bool) -> None:
    """Let go as it arrives, and later commanded further for a while, which moves nothing."""
    q = sweeps([0.3, -0.4, INTO_BOTH[0], 0.2, -0.3], 1)
    stands = np.flatnonzero(np.abs(q - UPPER[0]) < 5.0 * NOISE)
    q = np.insert(q, stands[-1], np.full(80, UPPER[0])) - 0.2
    held = logs(q, is_pushed=False)
    begin = stands[-1] + 10
    held.command[0, begin : begin + held_rows, 0] = 1.0
    speed = np.array([SPEED])
    found = encoders(
        stops(logs(sweeps(INTO_BOTH, 0)), LOWER, UPPER, speed), stops(held, LOWER, UPPER, speed), LOWER, UPPER
    )
    assert bool(found) == is_sure
    if is_sure:
        assert found[0].errors[0].point["offset"] == pytest.approx(-0.2, abs=0.005)


def test_an_encoder_that_slips_mid_way_is_seen_with_its_moment() -> None:
    nominal = logs(sweeps(INTO_BOTH, 0))
    q = sweeps(INTO_BOTH * 5, 1)
    slipped = len(q) * 3 // 5
    q[slipped:] += 0.05
    encoder = encoders_of(nominal, logs(q), LOWER, UPPER, np.array([SPEED]))[0]
    assert encoder.onset is not None
    assert abs(encoder.onset * 1e-9 - slipped * DT_S) < 30.0
    assert abs(encoder.errors[0].point["offset"] - 0.05) < 2.0 * encoder.errors[0].deviation
    always = encoders_of(nominal, logs(sweeps(INTO_BOTH * 5, 1) + 0.05), LOWER, UPPER, np.array([SPEED]))[0]
    assert always.onset is None


def test_turning_short_of_the_stops_says_nothing() -> None:
    random = np.random.default_rng(2)
    turns = 0.4 * np.sign(np.resize([1.0, -1.0], 20)) + 0.05 * random.standard_normal(20)
    assert judged(sweeps(INTO_BOTH, 0), sweeps(turns, 3)) == {}


def test_a_joint_that_drifts_to_its_furthest_reading_has_met_no_stop() -> None:
    creep = np.concatenate([np.linspace(0.0, 0.3, 400), np.full(100, 0.3)])
    assert judged(sweeps(INTO_BOTH, 0), np.tile(np.concatenate([creep, creep[::-1]]), 4)) == {}
