"""What the commands of a log did: statistics per joint, delays, and what the data will not tell."""

import numpy as np

from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification

AT_REST_BEFORE_ROWS = 10  # half a second at 20 Hz: a delay is measured on starts from rest only
MOTION_OF_RANGE = 0.002  # a joint has started to move once it is this share of its range from where it rested
MOTION_IN_NOISE = 5.0  # and this many standard deviations of its rest noise
LONGEST_DELAY_S = 3.0
FEW_STARTS = 5
ALONE_AT_LEAST_S = 2.0
COVERED_OF_RANGE = 0.5
NEAR_LIMIT_OF_RANGE = 0.02


def command_statistics(
    trajectories: list[Trajectory], joint: int, dt_s: float
) -> dict[str, float | int | None]:
    """Measure the commands of one joint: shares of time, starts, how long commands are held."""
    a = np.concatenate([trajectory.a for trajectory in trajectories])
    own = a[:, joint]
    others = np.delete(a, joint, axis=1)
    alone = (own != 0) & (others == 0).all(axis=1)
    starts = [_starts(trajectory.a[:, joint]) for trajectory in trajectories]
    n_starts = sum(len(rows) for rows in starts)
    active = own[own != 0]
    return {
        "share_negative": float((own < 0).mean()),
        "share_zero": float((own == 0).mean()),
        "share_positive": float((own > 0).mean()),
        "mean_magnitude_when_active": float(np.abs(active).mean()) if len(active) else None,
        "n_starts": n_starts,
        "mean_active_s": float(len(active) * dt_s / n_starts) if n_starts else None,
        "alone_s": float(alone.sum() * dt_s),
    }


def apparent_delay_s(
    trajectories: list[Trajectory], joint: int, machine: MachineSpecification
) -> tuple[float | None, int]:
    """Measure the time from a command's start to the joint's first visible motion, over starts from rest.

    Visible is a distance from the rest position, towards the command's side or away from it, of
    `MOTION_OF_RANGE` of the joint's range or `MOTION_IN_NOISE` times the noise at rest, whichever is more;
    the moment is interpolated between rows. It holds dead time, the start of the response, and the clocks'
    offset.

    Returns:
        The median in s (None if there was no such start), and the number of starts that it is of.
    """
    span = machine.joints[joint].upper - machine.joints[joint].lower
    horizon = round(LONGEST_DELAY_S * machine.rate_hz)
    parts = [
        _delays_in_rows(trajectory.q[:, joint], trajectory.a[:, joint], MOTION_OF_RANGE * span, horizon)
        for trajectory in trajectories
    ]
    delays = np.concatenate(parts) * machine.dt_s
    return (float(np.median(delays)) if len(delays) else None), len(delays)


def _delays_in_rows(q: np.ndarray, a: np.ndarray, least_distance: float, horizon: int) -> np.ndarray:
    """Measure each start's delay in rows, shape (n_delays,): starts from rest that are followed by motion."""
    rows = _starts(a)
    rows = rows[(rows >= AT_REST_BEFORE_ROWS) & (rows + 1 < len(a))]
    before = rows[:, None] + np.arange(-AT_REST_BEFORE_ROWS, 0)
    at_rest = (a[before] == 0).all(axis=1)
    rows, before = rows[at_rest], before[at_rest]
    threshold = np.maximum(least_distance, MOTION_IN_NOISE * q[before].std(axis=1))
    after = rows[:, None] + np.arange(horizon)
    within = after < len(a)
    after = np.minimum(after, len(a) - 1)
    held = np.logical_and.accumulate(within & (np.sign(a[after]) == np.sign(a[rows])[:, None]), axis=1)
    distance = np.abs(q[after] - q[before].mean(axis=1)[:, None])
    beyond = held & (distance > threshold[:, None])
    first = beyond.argmax(axis=1)
    moved = np.flatnonzero(beyond.any(axis=1) & (first > 0))  # in row 0 it was in motion already
    last, threshold = first[moved], threshold[moved]
    nearer, farther = distance[moved, last - 1], distance[moved, last]
    return last - 1 + np.clip((threshold - nearer) / (farther - nearer), 0.0, 1.0)


def frozen_stretches(
    trajectories: list[Trajectory], joint: int, machine: MachineSpecification, frozen_after_s: float
) -> int:
    """Count stretches in which the position repeats exactly while the joint is commanded, off its limits."""
    limit = machine.joints[joint]
    margin = NEAR_LIMIT_OF_RANGE * (limit.upper - limit.lower)
    n_rows = round(frozen_after_s * machine.rate_hz)
    count = 0
    for trajectory in trajectories:
        q, a = trajectory.q[:, joint], trajectory.a[:, joint]
        inside = (q > limit.lower + margin) & (q < limit.upper - margin)
        still = np.concatenate([[False], (np.diff(q) == 0)]) & (a != 0) & inside
        edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(np.int8), [0]])))
        count += int((edges[1::2] - edges[::2] >= n_rows).sum())
    return count


def findings(trajectories: list[Trajectory], machine: MachineSpecification) -> list[str]:
    """Say what later stages will find missing in the data, one sentence each."""
    sentences = []
    for number, joint in enumerate(machine.joints):
        statistics = command_statistics(trajectories, number, machine.dt_s)
        for direction, share in (("negative", "share_negative"), ("positive", "share_positive")):
            if statistics[share] == 0:
                sentences.append(f"{joint.name} is never commanded in {direction} direction.")
        if not statistics["n_starts"]:
            continue
        if (statistics["alone_s"] or 0.0) < ALONE_AT_LEAST_S:
            sentences.append(
                f"{joint.name} moves alone for {statistics['alone_s']:.1f} s only: its own response and what "
                "the other joints take from it cannot be told apart."
            )
        if statistics["n_starts"] < FEW_STARTS:
            sentences.append(f"{joint.name} is started {statistics['n_starts']} times only.")
        q = np.concatenate([trajectory.q[:, number] for trajectory in trajectories])
        covered = float(np.ptp(q)) / (joint.upper - joint.lower)
        if covered < COVERED_OF_RANGE:
            sentences.append(f"{joint.name} covers {covered:.0%} of its range.")
    return sentences


def _starts(a: np.ndarray) -> np.ndarray:
    """Rows at which a command leaves zero."""
    return np.flatnonzero((a[1:] != 0) & (a[:-1] == 0)) + 1
