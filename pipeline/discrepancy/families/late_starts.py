"""How much later a joint starts after rests than it did, from the moments at which it starts to move.

The wrapper of `stiction` holds a command back, and the network then answers it as any command. A spool that was locked
lets go under the pressure that has built up meanwhile: the joint starts later than that, and catches up some of it.
What the wrapper is fitted to is the way lost; what a late start means is the time until there is motion. Likewise the
wrapper counts rest from the command's end, and the joint rests once it has come to a stand.
"""

from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.diagnosis.sequences import Sequences

MOVING_SHARE = 0.1  # of the usual speed: from there on a joint moves
MOVING_ROWS = 3  # in a row: encoder noise alone is as fast now and then
SHORTEST_HOLD_S = 1.0  # of commands that count
ROOM_S = 0.5  # of usual speed, up to the furthest reading: who is nearer to a stop may not move for that
LONG_REST = 2.0  # thresholds: after such a rest little of the lock is missing
FEWEST_STARTS = 5  # after long rests, in one direction, in either logs


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
    """(n,) each: direction of the command, its rest before, s, and time until the joint moves, s.

    Also (m,) time until it stands, s.
    """

    direction: np.ndarray
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
    """How late a joint starts, where it stands and has room to move; None where too few starts follow a long rest.

    Args:
        nominal: Logs of the machine as it was, and (B,) steps by which each of them is read late.
        measured: The same of the machine as it is; rows that may not be looked at are none (`is_row`).
        joint: Index.
        threshold_s: Rest of the command at which half of the extra time is there.
        speed: Usual speed of the joint, rad/s or m/s.
        dt_s: Length of a row.
    """
    logs = (nominal, measured)
    reached = np.concatenate([of.q[of.is_row][:, joint] for of, _ in logs])
    ends = float(reached.min(initial=np.inf)), float(reached.max(initial=-np.inf))
    before, after = (_starts(*of, joint, speed, ends, dt_s) for of in logs)
    if len(after.stopping_s) == 0:
        return None
    extra, variance, weight = [], [], []
    for direction in (-1.0, 1.0):  # dead times differ by direction, and so may the share of starts in each
        long = [
            of.start_s[(of.direction == direction) & (of.rest_s > LONG_REST * threshold_s)]
            for of in (before, after)
        ]
        if min(map(len, long)) >= FEWEST_STARTS:
            extra.append(float(long[1].mean() - long[0].mean()))
            variance.append(sum(float(of.var(ddof=1)) / len(of) for of in long))
            weight.append(float(len(long[1])))
    if not extra:
        return None
    share = np.array(weight) / sum(weight)
    deviation = float(np.sqrt(share**2 @ np.array(variance)))
    return LateStarts(float(share @ extra), deviation, float(np.median(after.stopping_s)))


def _starts(
    logs: Sequences, phases: np.ndarray, joint: int, speed: float, ends: tuple[float, float], dt_s: float
) -> _Starts:
    """Starts of a joint that stands and has room to move, and its stops; `ends` are its furthest readings."""
    starts: list[tuple[float, float, float]] = []
    stopping: list[float] = []
    threshold = MOVING_SHARE * speed
    for log, phase_s in enumerate(np.asarray(phases, float) * dt_s):
        command, velocity = logs.command[log, :, joint], logs.velocity[log, :, joint]
        # which way the joint goes under a positive command
        positive = float(np.sign(np.sum(logs.is_row[log] * command * velocity)))
        changes = np.flatnonzero(np.diff(command) != 0.0) + 1
        for previous, begin, end in zip(changes[:-2], changes[1:-1], changes[2:], strict=True):
            if not logs.is_row[log, previous:end].all():
                continue
            if command[begin] == 0.0:
                way = np.sign(velocity[begin])
                stands = _first_below(way * velocity[begin:end], threshold)
                if abs(velocity[begin]) > 2.0 * threshold and stands is not None:
                    stopping.append(stands * dt_s - phase_s)
            elif command[begin - 1] == 0.0 and (end - begin) * dt_s >= SHORTEST_HOLD_S:
                way = positive * np.sign(command[begin])
                room = abs((ends[1] if way > 0.0 else ends[0]) - logs.q[log, begin, joint])
                stands_before = np.abs(velocity[max(begin - MOVING_ROWS, 0) : begin]).max() < threshold
                if stands_before and room > ROOM_S * speed:
                    moves = _first_lasting(way * velocity[begin:end], threshold)
                    # a start that failed is at least as late as its command is long
                    until_s = (end - begin if moves is None else moves) * dt_s - phase_s
                    starts.append((float(np.sign(command[begin])), (begin - previous) * dt_s, until_s))
    direction, rest_s, start_s = np.array(starts, float).reshape(-1, 3).T
    return _Starts(direction, rest_s, start_s, np.array(stopping))


def _first_below(values: np.ndarray, threshold: float) -> float | None:
    """Rows until `values` (n,) fall below a threshold, interpolated; None if they never do."""
    below = np.flatnonzero(values < threshold)
    return _crossing(values, threshold, int(below[0])) if len(below) else None


def _first_lasting(values: np.ndarray, threshold: float) -> float | None:
    """Rows until `values` (n,) rise above a threshold for `MOVING_ROWS` rows, interpolated; None if they never do."""
    above = np.convolve(values > threshold, np.ones(MOVING_ROWS), mode="valid") == MOVING_ROWS
    lasting = np.flatnonzero(above)
    return _crossing(values, threshold, int(lasting[0])) if len(lasting) else None


def _crossing(values: np.ndarray, threshold: float, place: int) -> float:
    """Where between the row before `place` and it the threshold is crossed, rows; a row's mean is of its middle."""
    if place == 0:
        return 0.0
    return place - 1 + float((values[place - 1] - threshold) / (values[place - 1] - values[place])) + 0.5
