"""How much later a joint starts after rests than it did, from the moments at which it starts to move.

The wrapper of `stiction` holds a command back, and the network then answers it as any command. A spool that was locked
lets go under the pressure that has built up meanwhile: the joint starts later than that, and catches up some of it.
What the wrapper is fitted to is the way lost; what a late start means is the time until there is motion. Likewise the
wrapper counts rest from the command's end, and the joint rests once it has come to a stand.
"""

from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.sequences import Sequences

MOVING_SHARE = 0.1  # of the speed reached: from there on a joint moves
FULL_SPEED_S = (0.8, 1.0)  # after the command: the speed that it reaches
SHORTEST_HOLD_S = 1.0  # of commands that count
SLOWEST_SHARE = 0.3  # of the usual speed: what stays slower runs into a stop or never starts
LONG_REST = 2.0  # thresholds: after such a rest little of the lock is missing
FEWEST_STARTS = 8  # after long rests, in either logs


class LateStarts(NamedTuple):
    """Of one joint, s, each with its standard deviation.

    Attributes:
        extra_s: By which starts after long rests are later than on nominal logs, in the mean.
        extra_deviation_s: Of that.
        stopping_s: From the end of a command until the joint stands, in the mean.
    """

    extra_s: float
    extra_deviation_s: float
    stopping_s: float


class _Starts(NamedTuple):
    """(n,) each, s: rest of the command before, and time until the joint moves; (m,) time until it stands."""

    rest_s: np.ndarray
    start_s: np.ndarray
    stopping_s: np.ndarray


def late_starts(
    nominal: tuple[Sequences, np.ndarray],
    measured: tuple[Sequences, np.ndarray],
    joint: int,
    threshold_s: float,
    speed: float,
    dt_s: float,
) -> LateStarts | None:
    """How late a joint starts; None where too few starts follow a long rest.

    Args:
        nominal: Logs of the machine as it was, and (B,) steps by which each of them is read late.
        measured: The same of the machine as it is; rows that may not be looked at are none (`is_row`).
        joint: Index.
        threshold_s: Rest of the command at which half of the extra time is there.
        speed: Usual speed of the joint, rad/s or m/s.
        dt_s: Length of a row.
    """
    before, after = (_starts(logs, phases, joint, speed, dt_s) for logs, phases in (nominal, measured))
    long = [of.start_s[of.rest_s > LONG_REST * threshold_s] for of in (before, after)]
    if min(map(len, long)) < FEWEST_STARTS or len(after.stopping_s) == 0:
        return None
    extra = float(long[1].mean() - long[0].mean())
    deviation = float(np.sqrt(sum(of.var(ddof=1) / len(of) for of in long)))
    return LateStarts(extra, deviation, float(np.median(after.stopping_s)))


def _starts(logs: Sequences, phases: np.ndarray, joint: int, speed: float, dt_s: float) -> _Starts:
    rests: list[float] = []
    starts: list[float] = []
    stopping: list[float] = []
    for log, phase_s in enumerate(np.asarray(phases, float) * dt_s):
        command, velocity = logs.command[log, :, joint], logs.velocity[log, :, joint]
        changes = np.flatnonzero(np.diff(command) != 0.0) + 1
        for previous, begin, end in zip(changes[:-2], changes[1:-1], changes[2:], strict=True):
            if not logs.is_row[log, previous:end].all():
                continue
            held_s = (end - begin) * dt_s
            if command[begin] == 0.0:
                way = np.sign(velocity[begin])
                stands = _first_below(
                    way * velocity[begin:end], MOVING_SHARE * abs(velocity[previous:begin]).max()
                )
                if abs(velocity[begin]) > SLOWEST_SHARE * speed and stands is not None:
                    stopping.append(stands * dt_s - phase_s)
            elif command[begin - 1] == 0.0 and held_s >= SHORTEST_HOLD_S:
                first, last = (begin + round(s / dt_s) for s in FULL_SPEED_S)
                reached = float(velocity[first:last].mean())
                moves = _first_below(-np.sign(reached) * velocity[begin:end], -MOVING_SHARE * abs(reached))
                if abs(reached) > SLOWEST_SHARE * speed and moves is not None:
                    rests.append((begin - previous) * dt_s)
                    starts.append(moves * dt_s - phase_s)
    return _Starts(np.array(rests), np.array(starts), np.array(stopping))


def _first_below(values: np.ndarray, threshold: float) -> float | None:
    """Rows until `values` (n,) fall below a threshold, interpolated; None if they never do."""
    below = np.flatnonzero(values < threshold)
    if len(below) == 0:
        return None
    place = int(below[0])
    if place == 0:
        return 0.0
    # A row's velocity is the mean over it: it belongs to the row's middle.
    fallen = (values[place - 1] - threshold) / (values[place - 1] - values[place])
    return place - 1 + float(fallen) + 0.5
