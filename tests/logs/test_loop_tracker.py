import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pipeline.errors import InputError
from pipeline.logs import tracked_velocities
from pipeline.logs.loop_tracker import LoopTrackerConfig, advance, initial_state
from pipeline.logs.tracked_velocities import track

positions = hnp.arrays(
    np.float64,
    st.tuples(st.integers(1, 40), st.integers(1, 5)),
    elements=st.floats(-10, 10, allow_subnormal=False),
)
gains = st.builds(LoopTrackerConfig, st.floats(0.1, 30), st.floats(0.1, 300))


def contract(q, dt, kp, ki):
    """Contract, section 2, word for word."""
    velocity = np.zeros_like(q)
    for joint in range(q.shape[1]):
        q_hat, i = q[0, joint], 0.0
        for t in range(len(q)):
            e = q[t, joint] - q_hat
            i += ki * e * dt
            q_hat += dt * (kp * e + i)
            velocity[t, joint] = i
    return velocity


@given(positions, gains)
def test_track_is_the_contracts_loop(q, gains):
    expected = contract(q, 0.05, gains.proportional_gain, gains.integral_gain)
    np.testing.assert_array_equal(track(q, 0.05, gains), expected)


@given(positions, gains)
def test_online_and_offline_agree_bit_for_bit(q, gains):
    state, online = initial_state(q[0]), []
    for sample in q:
        state, velocity = advance(state, sample, 0.05, gains)
        online.append(velocity)
    np.testing.assert_array_equal(track(q, 0.05, gains), np.array(online))


@pytest.mark.parametrize("speed", [-0.7, 0.0, 0.3])
def test_constant_velocity_is_found(loop_tracker, speed):
    """The loop is of type two: a ramp is tracked without error."""
    q = speed * 0.05 * np.arange(400)[:, None] + np.array([[0.2, -1.0]])
    np.testing.assert_allclose(track(q, 0.05, loop_tracker)[-1], speed, atol=1e-12)


def test_step_response_is_that_of_the_closed_loops_matrix(loop_tracker):
    """(e, i) after each sample is A (e, i) with A from the contract's lines; the loop is stable."""
    dt, kp, ki = 0.05, loop_tracker.proportional_gain, loop_tracker.integral_gain
    matrix = np.array([[1 - dt * kp - dt * dt * ki, -dt], [ki * dt, 1.0]])
    assert np.abs(np.linalg.eigvals(matrix)).max() < 1.0
    q = np.concatenate([np.zeros((1, 1)), np.ones((30, 1))])
    expected = [(np.linalg.matrix_power(matrix, t) @ [1.0, 0.0])[1] for t in range(31)]
    np.testing.assert_allclose(track(q, dt, loop_tracker)[:, 0], expected, atol=1e-13)


def test_gains_must_be_positive():
    with pytest.raises(InputError, match="proportional_gain"):
        LoopTrackerConfig(0.0, 60.0)
    with pytest.raises(InputError, match="integral_gain"):
        LoopTrackerConfig(10.0, -1.0)


def test_compiled_and_interpreted_agree_bit_for_bit(loop_tracker, monkeypatch):
    q = np.random.default_rng(0).normal(size=(100_000, 2)).cumsum(axis=0)
    ways = []
    for worth in (math.inf, 0):
        monkeypatch.setattr(tracked_velocities, "WORTH_COMPILING", worth)
        ways.append(track(q, 0.05, loop_tracker))
    np.testing.assert_array_equal(*ways)


def test_no_folder_for_compiled_code_can_be_written(monkeypatch):
    """A read-only checkout and a home that cannot be written: it is compiled in each process."""
    import numba
    from numba.core.caching import CacheImpl

    monkeypatch.setattr(CacheImpl, "_locator_classes", [])
    tracked_velocities._compiled.cache_clear()
    with pytest.raises(RuntimeError, match="no locator available"):
        numba.njit(cache=True)(tracked_velocities._follow)
    q = np.cumsum(np.random.default_rng(0).normal(size=(50, 2)), axis=0)
    config = LoopTrackerConfig(5.0, 50.0)
    expected = track(q, 0.05, config)
    monkeypatch.setattr(tracked_velocities, "WORTH_COMPILING", 0)
    np.testing.assert_array_equal(track(q, 0.05, config), expected)
    tracked_velocities._compiled.cache_clear()
