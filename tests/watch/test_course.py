"""The course of a machine of two joints, from statistics that are drawn here."""

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.watch.course import Course, State, follow
from pipeline.watch.settings import WatchConfig
from pipeline.watch.statistics import STATISTICS

CONFIG = load_section("watch", WatchConfig, "paper")
SPREAD = np.array([statistic.least / 3.0 for statistic in STATISTICS])
LATENESS = [statistic.name for statistic in STATISTICS].index("lateness")


def drawn(n: int, seed: int) -> np.ndarray:
    """(n, 2, n_statistic) of a sound machine."""
    return SPREAD * np.random.default_rng(seed).standard_normal((n, 2, len(SPREAD)))


def followed(sessions: np.ndarray, baselines: tuple[int, ...] = (), n_nominal: int = 10) -> Course:
    return follow(drawn(n_nominal, 99), sessions, baselines, CONFIG)


def test_a_sound_machine_is_healthy() -> None:
    course = followed(drawn(60, 0))
    assert np.all(course.state == State.healthy)
    assert not course.changes


def test_a_step_on_one_joint_is_told_of_this_joint_with_its_session() -> None:
    sessions = drawn(20, 1)
    sessions[12:, 1, LATENESS] += 0.1  # s
    course = followed(sessions)
    (change,) = course.changes
    assert change.alarm in (12, 13)
    assert change.onset.first == 12
    assert (change.leading.joint, change.leading.statistic, change.end) == (1, LATENESS, None)
    assert np.all(course.state[change.alarm :, 1] == State.changed)
    assert np.all(course.state[:, 0] == State.healthy)


def test_a_ramp_is_told_before_it_is_whole() -> None:
    alarms = []
    for seed in range(8):
        sessions = drawn(40, 100 + seed)
        sessions[5:, 0, LATENESS] += 0.1 * np.minimum(np.arange(1, 36) / 30.0, 1.0)
        (change,) = followed(sessions).changes
        alarms.append(change.alarm)
        assert change.onset.is_ramp
    assert np.median(alarms) < 35


def test_a_repaired_machine_is_healthy_again_and_its_next_change_is_told() -> None:
    sessions = drawn(40, 2)
    sessions[8:16, 1, LATENESS] += 0.1
    sessions[30:, 0, LATENESS] += 0.1
    course = followed(sessions)
    first, second = course.changes
    assert first.end == 16
    assert np.all(course.state[16 : second.alarm] == State.healthy)
    assert (second.onset.first, second.leading.joint) == (30, 0)


def test_after_maintenance_ten_sessions_are_the_new_baseline() -> None:
    sessions = drawn(50, 3)
    sessions[20:] += 6.0 * SPREAD  # other parts: all is a little different, and stays so
    assert followed(sessions).changes
    course = followed(sessions, baselines=(20,))
    assert not course.changes
    assert np.all(course.state[20:30] == State.not_enough)
    assert np.flatnonzero(course.is_baseline).tolist() == list(range(20, 30))
    assert np.all(course.state[30:] == State.healthy)


@pytest.mark.parametrize("n_nominal", [0, 9])
def test_fewer_nominal_sessions_than_ten_are_not_enough(n_nominal: int) -> None:
    sessions = drawn(20, 4)
    sessions[10:] += 1.0
    course = followed(sessions, n_nominal=n_nominal)
    assert np.all(course.state == State.not_enough)
    assert np.all(course.e_value == 1.0)


def test_a_joint_that_hardly_moves_is_not_judged_and_hides_no_other() -> None:
    sessions = drawn(20, 5)
    sessions[:, 0] = np.nan
    sessions[10:, 1, LATENESS] += 0.1
    course = followed(sessions)
    assert np.all(course.state[:, 0] == State.not_enough)
    assert course.changes[0].leading.joint == 1
