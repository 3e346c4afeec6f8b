"""Trials cut out of made-up logs, against the arm's geometry written out (contract, section 1)."""

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.logs.messages.raw_log import TargetPoses
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import JointSpecification, MachineSpecification
from pipeline.reaching.logged_trials import logged_trials, reaching_summary, trial_traces
from tests.reaching.reference import orientation

STEP_NS = 50_000_000


def tip(q) -> np.ndarray:
    """Position of the chisel tip of `bobcat_e10`."""
    swing, *angles = q
    sums = np.cumsum(angles)
    lengths = np.array([1.35, 0.80, 0.65])
    radius, z = 0.25 + lengths @ np.cos(sums), 0.50 + lengths @ np.sin(sums)
    return np.array([radius * np.cos(swing), radius * np.sin(swing), z])


def chisel(q) -> np.ndarray:
    """Its orientation."""
    return orientation(q[0], q[1:].sum() + np.pi / 2)


def drive(n_rows: int, seed: int = 0, first_row: int = 0, name: str = "drive") -> Trajectory:
    """The arm wanders about within its limits."""
    rows = first_row + np.arange(n_rows)
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, 4)
    middle, spread = np.array([0.0, 0.5, -1.4, -0.7]), np.array([0.5, 0.3, 0.5, 0.6])
    q = middle + spread * np.sin(0.02 * rows[:, None] * np.array([1.0, 1.3, 0.8, 1.7]) + phases)
    zeros = np.zeros((n_rows, 4))
    return Trajectory(name, 0.05 * rows, STEP_NS * rows, q, zeros, zeros + rows[:, None], zeros[:, 0] > 0)


def targets(rows, configurations, late_ns: int = -1) -> TargetPoses:
    """Targets published shortly before the given rows."""
    return TargetPoses(
        np.array(rows) * STEP_NS + late_ns,
        np.array([tip(q) for q in configurations]),
        np.array([chisel(q) for q in configurations]),
        "base_link",
    )


def extents(trials) -> list[tuple[str, int, int]]:
    return [(trial.trajectory.name, trial.start, trial.end) for trial in trials]


def test_a_trial_lasts_until_the_next_target_the_timeout_or_the_end():
    log = drive(400)
    trials = logged_trials([log], targets([10, 60, 350], log.q[[0, 1, 2]]), maximum_ticks=200)
    assert extents(trials) == [("drive", 10, 60), ("drive", 60, 260), ("drive", 350, 399)]


def test_a_target_is_in_force_from_the_first_row_that_is_not_before_it():
    log = drive(100)
    for late_ns, start in ((-1, 30), (0, 30), (1, 31)):
        (trial,) = logged_trials([log], targets([30], log.q[:1], late_ns), 500)
        assert trial.start == start


def test_repeated_messages_begin_no_trial_and_old_targets_are_replaced():
    log = drive(200)
    given = targets([-50, -20, 40, 80, 120], log.q[[0, 1, 1, 1, 2]])
    assert extents(logged_trials([log], given, 500)) == [("drive", 0, 120), ("drive", 120, 199)]


def test_a_gap_ends_a_trial_and_a_target_within_it_begins_one_after_it():
    logs = [drive(100), drive(100, first_row=150, name="drive#1"), drive(100, first_row=300, name="drive#2")]
    given = targets([20, 120, 200], logs[0].q[[0, 1, 2]])
    assert extents(logged_trials(logs, given, 500)) == [
        ("drive", 20, 99),
        ("drive#1", 0, 50),
        ("drive#1", 50, 99),
    ]


def test_poses_that_are_none_are_no_targets():
    log = drive(100)
    given = targets([10, 20, 30], log.q[[0, 1, 2]])
    given.quaternion[1] = 0.0
    given.position[2, 0] = np.nan
    assert extents(logged_trials([log], given, 500)) == [("drive", 10, 99)]
    assert logged_trials([log], targets([200], log.q[:1]), 500) == []


def test_traces_follow_the_geometry(bobcat, arm):
    log = drive(120)
    aims = log.q[[5, 90]] + 0.1
    trials = logged_trials([log], targets([10, 50], aims), 500)
    traces = trial_traces(trials, bobcat, arm)
    assert traces.q.shape == (2, 69, 4)
    for number, (start, end) in enumerate([(10, 50), (50, 119)]):
        rows, n = np.arange(start + 1, end + 1), end - start
        positions = np.array([tip(q) for q in log.q[rows]])
        np.testing.assert_allclose(traces.start_position[number], tip(log.q[start]), atol=1e-9)
        np.testing.assert_allclose(traces.position[number, :n], positions, atol=1e-9)
        distances = np.linalg.norm(positions - tip(aims[number]), axis=1)
        np.testing.assert_allclose(traces.position_error[number, :n], distances, atol=1e-9)
        pitch_errors = log.q[rows, 1:].sum(axis=1) - aims[number, 1:].sum()
        np.testing.assert_allclose(traces.pitch_error[number, :n], pitch_errors, atol=1e-9)
        np.testing.assert_array_equal(traces.command[number, :n], log.a[rows - 1])
        np.testing.assert_array_equal(traces.q[number, n:], np.tile(log.q[end], (69 - n, 1)))


def test_the_summary_counts_what_was_reached(bobcat, arm):
    """The first target is a pose that is passed, the second one lies 0.1 m aside of one."""
    log = drive(300)
    given = targets([10, 150], log.q[[40, 200]])
    given.position[1, 2] += 0.1
    summary = reaching_summary(logged_trials([log], given, 500), bobcat, arm)
    assert summary["n_episodes"] == 2
    assert summary["sr_002_002"] == summary["sr_004_004"] == 0.5
    first, second = summary["trials"]
    assert (first["sr_002_002"], second["sr_002_002"], second["sr_012_008"]) == (1.0, 0.0, 1.0)
    assert first["nearest_position_error_m"] == pytest.approx(0.0, abs=1e-9)
    assert first["nearest_pitch_error_rad"] == pytest.approx(0.0, abs=1e-9)
    assert first["final_position_error_m"] == pytest.approx(np.linalg.norm(tip(log.q[150]) - tip(log.q[40])))
    assert second["t"] == 7.5 and second["n_ticks"] == 149
    way = np.array([tip(q) for q in log.q[150:300]])
    length = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    assert second["path_length_m"] == pytest.approx(length, rel=1e-9)
    assert summary["min_z_m"] == pytest.approx(min(tip(q)[2] for q in log.q[11:]), rel=1e-9)
    matrix = np.array(summary["success_rates"]["matrix"])
    assert matrix[0, 0] == summary["sr_002_002"] and matrix[5, 3] == summary["sr_012_008"]
    assert "average_return" not in summary  # it takes target configurations


def test_the_sign_and_the_length_of_a_quaternion_do_not_count(bobcat, arm):
    log = drive(100)
    given = targets([10], log.q[50:51])
    other = TargetPoses(given.log_time_ns, given.position, -3.0 * given.quaternion, "base_link")
    one, two = (trial_traces(logged_trials([log], poses, 500), bobcat, arm) for poses in (given, other))
    np.testing.assert_allclose(one.pitch_error, two.pitch_error, atol=1e-12)


def test_a_machine_without_workspace_is_an_input_error(arm):
    joints = [JointSpecification(name, -3.0, 3.0) for name in ("swing", "boom", "arm", "bucket")]
    log = drive(100)
    trials = logged_trials([log], targets([10], log.q[:1]), 500)
    with pytest.raises(InputError, match="no section workspace"):
        trial_traces(trials, MachineSpecification("bare", 20.0, joints), arm)
