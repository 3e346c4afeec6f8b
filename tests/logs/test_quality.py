import numpy as np
import pytest

from pipeline.logs.conditioning.excitation import Excitation
from pipeline.logs.quality import sampling
from pipeline.logs.tuples import Trajectory


def trajectory_of(q, a):
    n = len(q)
    return Trajectory(
        "t", np.arange(n) * 0.05, np.arange(n) * 50_000_000, q, np.zeros_like(q), a, np.zeros(n, bool)
    )


def of(trajectory, machine, frozen_after_s=2.0):
    return Excitation.of([trajectory], machine, frozen_after_s)


@pytest.fixture
def strokes(machine):
    """Each joint is driven alone, to and fro, with rests between: constant speed after a known delay."""
    n_joint, delays, speed = machine.n_joint, [0.1, 0.2, 0.35, 0.5], 0.3
    rows = []
    for _ in range(6):
        for joint in range(n_joint):
            for direction in (1.0, -1.0):
                rows += [(joint, direction)] * 40 + [(joint, 0.0)] * 30
    a = np.zeros((len(rows), n_joint))
    for row, (joint, direction) in enumerate(rows):
        a[row, joint] = direction
    q = np.tile(0.5 * (machine.lower + machine.upper), (len(rows), 1))
    for joint, delay in enumerate(delays):
        shift = round(delay / 0.05)
        moving = np.concatenate([np.zeros(shift), a[: len(a) - shift, joint]])
        q[1:, joint] += np.cumsum(moving[:-1] * speed * 0.05)
    return trajectory_of(q, a), delays, speed


def test_apparent_delay_is_the_true_one_plus_the_way_to_be_seen(strokes, machine):
    trajectory, delays, speed = strokes
    for joint, delay in enumerate(delays):
        span = machine.upper[joint] - machine.lower[joint]
        measured, n_starts = of(trajectory, machine).apparent_delay_s(joint)
        assert n_starts == (11 if joint == 0 else 12)  # the very first stroke has no rest before it
        assert measured == pytest.approx(delay + 0.002 * span / speed, abs=1e-6)


def test_delay_of_a_joint_that_never_moves(machine):
    a = np.zeros((100, machine.n_joint))
    a[50:] = 1.0
    assert of(trajectory_of(np.zeros_like(a), a), machine).apparent_delay_s(0) == (None, 0)


def test_command_statistics(strokes, machine):
    trajectory, _, _ = strokes
    statistics = of(trajectory, machine).command_statistics(1)
    share = 1 / machine.n_joint / 2 * 40 / 70
    assert statistics["share_positive"] == statistics["share_negative"] == pytest.approx(share)
    assert statistics["n_starts"] == 12 and statistics["mean_active_s"] == pytest.approx(2.0)
    assert statistics["alone_s"] == pytest.approx(24.0)


def test_findings_say_what_is_missing(strokes, machine):
    trajectory, _, _ = strokes
    rich = " ".join(of(trajectory, machine).findings())
    assert "never commanded" not in rich and "alone" not in rich
    poor = trajectory_of(trajectory.q, np.abs(trajectory.a))
    assert "swing is never commanded in negative direction." in of(poor, machine).findings()
    together = trajectory.a.copy()
    together[:, 2] = together[:, 0]
    assert any(
        text.startswith("swing moves alone for 0.0 s only")
        for text in of(trajectory_of(trajectory.q, together), machine).findings()
    )


def test_frozen_encoder(strokes, machine):
    trajectory, _, _ = strokes
    assert of(trajectory, machine, 1.0).frozen_stretches(0) == 0
    q = trajectory.q.copy()
    q[:40, 0] = q[0, 0]  # the first stroke of 2 s, during which swing was commanded
    assert of(trajectory_of(q, trajectory.a), machine, 1.5).frozen_stretches(0) == 1
    q[:, 0] = machine.upper[0]  # at its end stop a joint may stand still under command
    assert of(trajectory_of(q, trajectory.a), machine, 1.5).frozen_stretches(0) == 0


def test_sampling():
    intervals = np.array([20, 20, 20, 600, 20]) * 1_000_000
    values = sampling(intervals, 0.5)
    assert values["rate_hz"] == pytest.approx(50) and values["n_gaps"] == 1
    assert values["longest_gap_s"] == pytest.approx(0.6)
    assert sampling(intervals[:0], 0.5)["rate_hz"] is None
