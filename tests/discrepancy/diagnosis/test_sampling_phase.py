"""The phase of a recording against velocities that are shifted in time by a known part of a step."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.sampling_phase import sampling_phases

N_ROWS, N_JOINT, FINE = 6000, 4, 20


def speeds(seed: int) -> np.ndarray:
    """(FINE N_ROWS, N_JOINT) velocities on a fine grid: lagged responses to moves of a second or so."""
    random = np.random.default_rng(seed)
    held = random.integers(-1, 2, size=(N_ROWS // 20 + 1, N_JOINT)).repeat(20 * FINE, axis=0)[: FINE * N_ROWS]
    lagged = np.zeros_like(held, dtype=float)
    for row in range(1, len(held)):
        lagged[row] = lagged[row - 1] + (held[row] - lagged[row - 1]) / (3 * FINE)
    return lagged


def sampled(fine: np.ndarray, late_steps: float, joints=range(N_JOINT)) -> np.ndarray:
    """Means over steps of velocities that come late on some joints."""
    shifted = fine.copy()
    for joint in joints:
        shifted[:, joint] = np.roll(fine[:, joint], round(late_steps * FINE))
    return shifted.reshape(N_ROWS, FINE, N_JOINT).mean(axis=1)


def found(measured: np.ndarray, predicted: np.ndarray) -> float:
    noise = 0.05 * np.random.default_rng(3).standard_normal(measured.shape)
    sequences = SimpleNamespace(velocity=(measured + noise)[None])
    simulation = SimpleNamespace(sequences=sequences, velocities=lambda _: predicted[None, None])
    return float(sampling_phases(simulation, np.ones((1, N_ROWS), bool))[0])


@pytest.mark.parametrize("late_steps", [-0.3, 0.0, 0.2, 0.4])
def test_the_phase_is_found_whatever_the_gains_are(late_steps):
    fine = speeds(0)
    measured = sampled(fine, late_steps) * np.array([1.0, 0.7, 1.3, 1.0])
    assert abs(found(measured, sampled(fine, 0.0)) - late_steps) < 0.05


def test_a_joint_that_is_late_by_itself_is_left_to_the_search():
    fine = speeds(1)
    assert abs(found(sampled(fine, 3.0, joints=[2]), sampled(fine, 0.0))) < 0.05


def test_what_is_later_than_half_a_step_on_all_joints_is_no_phase():
    fine = speeds(2)
    assert found(sampled(fine, 2.0), sampled(fine, 0.0)) == 0.0


def test_one_joint_alone_tells_no_phase():
    fine = speeds(4)[:, :1]
    one = fine.reshape(N_ROWS, FINE, 1).mean(axis=1)
    late = np.roll(fine, FINE // 5, axis=0).reshape(N_ROWS, FINE, 1).mean(axis=1)
    assert found(late, one) == 0.0
