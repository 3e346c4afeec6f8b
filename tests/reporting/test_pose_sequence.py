"""Moments of successive targets against a made-up drive, whose errors are known."""

import io
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.configuration.load import MACHINE_DIRECTORY, load_machine
from pipeline.logs.messages.raw_log import RawLog, TargetPoses
from pipeline.machine.kinematics import load_arm
from pipeline.machine.offscreen import RenderingUnavailableError
from pipeline.reporting.figures.pose_sequence import HEIGHT, MOMENTS, WIDTH, sequence_picture, ways_to

BOBCAT = load_machine("bobcat_e10")
ARM = load_arm(BOBCAT, MACHINE_DIRECTORY)
BEGIN_NS, STEP_NS = 1_775_000_000_000_000_000, 50_000_000
GOALS = np.array([[0.3, 0.9, -1.6, -0.7], [-0.4, 0.7, -1.2, -0.9]])
BENT = np.array([0.0, 0.0, 0.0, 0.15])  # at the bucket: a pitch that no tolerance of the tables allows


def drive(end: np.ndarray) -> RawLog:
    """In 5 s to the first goal's pose, in 5 s to `end`, and 1 s beyond it."""
    share = np.linspace(0.0, 1.0, 101)[:, None]
    first = share * GOALS[0] + (1 - share) * np.array([0.0, 0.5, -1.0, -1.0])
    second = share * end + (1 - share) * GOALS[0]
    q = np.concatenate([first, second[1:], end + 0.02 * np.arange(1, 21)[:, None]])
    time_ns = BEGIN_NS + STEP_NS * np.arange(len(q))
    pose = ARM.forward(GOALS)
    targets = TargetPoses(time_ns[[0, 100]], pose.position, pose.quaternion, "base_link")
    return RawLog("bag", Path(), time_ns, time_ns, q, time_ns[:1], 0 * q[:1], targets)


def test_a_way_ends_where_the_finest_precision_is_attained() -> None:
    log = drive(GOALS[1])
    ways = ways_to(BOBCAT, MACHINE_DIRECTORY, log, 2)
    for goal, way, begin in zip(GOALS, ways, (0, 100), strict=True):
        target, pitch = ARM.forward(goal).position, ARM.pitch(goal)
        n, distance = next(
            (n, np.linalg.norm(ARM.forward(q).position - target))
            for n, q in enumerate(np.asarray(log.q)[begin:])
            if np.linalg.norm(ARM.forward(q).position - target) < 0.02 and abs(ARM.pitch(q) - pitch) < 0.02
        )
        assert len(way.t_s) == n + 1 and way.t_s[-1] == pytest.approx(0.05 * n)
        np.testing.assert_array_equal(way.q, np.asarray(log.q)[begin : begin + n + 1])
        assert way.position_error[-1] == pytest.approx(distance)
        assert way.pitch_error[0] == pytest.approx(abs(ARM.pitch(way.q[0]) - pitch), abs=1e-5)
    assert len(ways_to(BOBCAT, MACHINE_DIRECTORY, log, 1)) == 1


def test_a_target_that_is_not_reached_is_shown_to_its_end() -> None:
    _, way = ways_to(BOBCAT, MACHINE_DIRECTORY, drive(GOALS[1] + BENT), 2)
    assert way.t_s[-1] == pytest.approx(6.0)


def test_the_picture_has_a_row_per_target() -> None:
    ways = ways_to(BOBCAT, MACHINE_DIRECTORY, drive(GOALS[1]), 2)
    try:
        picture = np.asarray(Image.open(io.BytesIO(sequence_picture(BOBCAT, MACHINE_DIRECTORY, ways))))
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    assert picture.shape == (2 * HEIGHT, MOMENTS * WIDTH, 3)
    moments = picture.reshape(2, HEIGHT, MOMENTS, WIDTH, 3).swapaxes(1, 2).astype(int)
    for row in moments:
        assert all((one != other).any() for one, other in pairwise(row))
