"""Reaching trials in logs: the paper's metrics for any controller or operator.

As in the paper's tests on the machine, a trial begins at a change of the target pose, from the present
configuration. It ends by time-out after T_reset ticks, at the next target, or at the recording's end.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.logs.messages.columns import as_array
from pipeline.logs.messages.raw_log import TargetPoses
from pipeline.logs.tuples import Trajectory
from pipeline.machine.kinematics import Arm
from pipeline.machine.orientation import yaw_pitch
from pipeline.machine.specification import MachineSpecification
from pipeline.machine.workspace import below_lower_plane, contains, workspace_of
from pipeline.reaching.metrics import (
    PITCH_THRESHOLDS_RAD,
    POSITION_THRESHOLDS_M,
    Traces,
    reaching_metrics,
    success_rate_matrix,
)


@dataclass(frozen=True)
class LoggedTrial:
    """One target and the rows of its trial.

    Attributes:
        trajectory: The recorded trajectory.
        start: First row with the target in force; the trial's ticks are rows start + 1 … end.
        end: Last row.
        position: Position of the target in {B}, m, shape (3,).
        quaternion: Orientation of the target, (w, x, y, z), shape (4,), of any length but zero.
    """

    trajectory: Trajectory
    start: int
    end: int
    position: np.ndarray
    quaternion: np.ndarray

    @property
    def n_ticks(self) -> int:
        """Number of ticks of the trial, at least one."""
        return self.end - self.start


def logged_trials(
    trajectories: Sequence[Trajectory], targets: TargetPoses, maximum_ticks: int
) -> list[LoggedTrial]:
    """Cut one log into trials.

    A target equal to the previous one is a repeated message and does not begin a trial. A target in a gap of the
    log begins its trial after the gap; a gap within a trial ends it.

    Args:
        trajectories: All of one log, in time order.
        targets: The target poses of that log.
        maximum_ticks: T_reset.

    Returns:
        Trials in time order. Targets without a tick before the next one are skipped, as are invalid poses (a
        non-finite value, or a zero quaternion).
    """
    time_ns, position, quaternion = map(as_array, (targets.log_time_ns, targets.position, targets.quaternion))
    order = np.argsort(time_ns, kind="stable")
    poses = np.concatenate([position, quaternion], axis=1)[order]
    usable = np.isfinite(poses).all(axis=1) & (np.abs(poses[:, 3:]).max(axis=1) > 0)
    poses, time_ns = poses[usable], time_ns[order][usable]
    changes = np.concatenate([[True], np.any(poses[1:] != poses[:-1], axis=1)])[: len(poses)]
    poses, time_ns = poses[changes], time_ns[changes]
    trials, done = [], -1
    for trajectory in trajectories:
        starts = np.searchsorted(trajectory.stamp_ns, time_ns)
        last_row = len(trajectory) - 1
        ends = np.minimum(np.append(starts[1:], last_row), last_row)
        for number in np.flatnonzero(ends > starts):
            if number > done:  # else the trial began before a gap
                start = int(starts[number])
                end = min(int(ends[number]), start + maximum_ticks)
                trials.append(LoggedTrial(trajectory, start, end, poses[number, :3], poses[number, 3:]))
                done = int(number)
    return trials


def trial_traces(trials: Sequence[LoggedTrial], machine: MachineSpecification, arm: Arm) -> Traces:
    """Traces of at least one trial, for the functions of `metrics`.

    Shorter trials are padded with their last tick, which does not change success, departures from W+ or path
    length. Rewards are NaN: they need a target configuration, and a log holds target poses.

    Raises:
        InputError: the machine has no workspace.
    """
    workspace = workspace_of(machine)
    ticks = 1 + np.arange(max(trial.n_ticks for trial in trials))
    rows = [np.minimum(trial.start + ticks, trial.end) for trial in trials]
    q = np.stack([trial.trajectory.q[row] for trial, row in zip(trials, rows, strict=True)])
    command = np.stack([trial.trajectory.a[row - 1] for trial, row in zip(trials, rows, strict=True)])
    start_q = np.stack([trial.trajectory.q[trial.start] for trial in trials])
    with jax.enable_x64(True):
        forward = jax.jit(arm.forward)
        position = forward(jnp.asarray(q)).position
        inside, below = (
            contains(workspace, position, arm.yaw(jnp.asarray(q))),
            below_lower_plane(workspace, position),
        )
        start_position = forward(jnp.asarray(start_q)).position
        _, target_pitch = yaw_pitch(jnp.asarray(np.stack([trial.quaternion for trial in trials])))
    target_position = np.stack([trial.position for trial in trials])[:, None]
    pitch_error = arm.pitch(q) - np.asarray(target_pitch)[:, None]
    return Traces(
        q=q,
        command=command,
        start_position=np.asarray(start_position),
        position=np.asarray(position),
        position_error=np.linalg.norm(np.asarray(position) - target_position, axis=-1),
        pitch_error=(pitch_error + np.pi) % (2 * np.pi) - np.pi,
        inside=np.asarray(inside),
        below=np.asarray(below),
        reward=np.full(q.shape[:2], np.nan),
    )


def reaching_summary(
    trials: Sequence[LoggedTrial], machine: MachineSpecification, arm: Arm
) -> dict[str, Any]:
    """The paper's metrics over all trials and per trial, for JSON.

    Returns:
        The metrics of `ReachingMetrics` but the return, `success_rates` (matrix over the thresholds), and
        `trials`, each with its metrics (rates are 0 or 1), the final errors, and those at its tick nearest to
        the target's position.

    Raises:
        InputError: the machine has no workspace.
    """
    traces = trial_traces(trials, machine, arm)
    return {
        **_metrics(traces, arm),
        "success_rates": {
            "position_thresholds_m": list(POSITION_THRESHOLDS_M),
            "pitch_thresholds_rad": list(PITCH_THRESHOLDS_RAD),
            "matrix": success_rate_matrix(traces).tolist(),
        },
        "trials": [
            _trial_summary(trial, Traces(*(array[i : i + 1] for array in traces)), arm)
            for i, trial in enumerate(trials)
        ],
    }


def _metrics(traces: Traces, arm: Arm) -> dict[str, Any]:
    metrics = reaching_metrics(traces, arm.surfaces).as_dict()
    del metrics["average_return"]
    return metrics


def _trial_summary(trial: LoggedTrial, traces: Traces, arm: Arm) -> dict[str, Any]:
    nearest = int(np.argmin(traces.position_error[0]))
    metrics = _metrics(traces, arm)
    del metrics["n_episodes"]
    return {
        "trajectory": trial.trajectory.name,
        "t": float(trial.trajectory.t_s[trial.start]),
        "n_ticks": trial.n_ticks,
        "target_position_m": trial.position.tolist(),
        "target_quaternion": trial.quaternion.tolist(),
        **metrics,
        "final_position_error_m": float(traces.position_error[0, -1]),
        "final_pitch_error_rad": float(traces.pitch_error[0, -1]),
        "nearest_position_error_m": float(traces.position_error[0, nearest]),
        "nearest_pitch_error_rad": float(traces.pitch_error[0, nearest]),
    }
