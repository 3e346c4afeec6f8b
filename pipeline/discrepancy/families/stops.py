"""Where a joint comes to a stand at its mechanical stops: the one place where an encoder can be checked by itself.

A joint that arrives fast and then stands, at the same reading time after time, has met its stop. Stops do not move;
where their reading does, it is the encoder's offset or scale, and where it does not, no encoder's error may explain
what else has changed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discrepancy.diagnosis.sequences import Sequences

NEAR_SHARE = 0.004  # of the range: around the furthest reading
SAME_SHARE = 0.0015  # of the range: readings of the same stop, medians over the first rows of a stand
STAND_ROWS = 4
ARRIVING_SHARE = 0.4  # of the usual speed, just before the stand: faster than a joint that was let go
ARRIVALS_BEFORE = 2  # at the same reading in nominal logs; once may be chance
ARRIVALS_AFTER = 3  # at the same reading elsewhere: more is claimed with it
PUSHED_ROWS = 30  # in all, of standing while commanded further: nothing but a stop holds a joint for so long
SPECIFIED_SHARE = 0.01  # of the range: how well a limit of the specification is known as a reading
MOVED = 5.0  # standard deviations
CONSISTENT = 3.0
MOMENT_ROWS = 400  # between the moments that are tried for a change mid-way
SMALLEST_PART_ROWS = 1200  # before and after such a moment


@dataclass(frozen=True)
class Stop:
    """A stop as the encoder reads it.

    Attributes:
        reading: rad or m.
        deviation: Of the reading.
        n_arrivals: How often it was met.
        is_pushed: Whether the joint stood there at least once while it was commanded further. Where an operator is
            in the habit of letting go, joints come to a stand at the same place, too.
        pushed_rows: For how long altogether.
    """

    reading: float
    deviation: float
    n_arrivals: int
    is_pushed: bool
    pushed_rows: int = 0

    @property
    def is_sure(self) -> bool:
        """Whether a joint was held there so often, or for so long, that it is no chance wherever it is."""
        return self.n_arrivals >= ARRIVALS_AFTER or self.pushed_rows >= PUSHED_ROWS


@dataclass(frozen=True)
class EncoderError:
    """An error that an encoder may have.

    Attributes:
        point: Of `sensor_bias`: its offset, or its scale.
        deviation: Standard deviation of that parameter.
    """

    point: Mapping[str, float]
    deviation: float


@dataclass(frozen=True)
class Encoder:
    """What the stops say of one joint's encoder.

    Attributes:
        errors: Each single error of an encoder that moves the stops as they moved, the likeliest first; none where they
            have not moved, or as no encoder's error moves them. One stop cannot tell an offset from a scale.
        z: How many standard deviations the stops are off their places.
        inward: How far the stops have moved towards the middle, rad or m: play in the linkage moves them so, by half of
            it; 0 if any has moved outward.
        pairs: (n, 3) readings before and after, and their deviation.
        onset: Absolute stamp, ns, until which the stops were where they had always been; None: moved all the time.
    """

    errors: tuple[EncoderError, ...]
    z: float
    inward: float
    pairs: np.ndarray
    onset: int | None = None

    def allows(self, point: Mapping[str, float]) -> bool:
        """Whether an encoder's error would leave the stops where they are read."""
        before, after, deviation = self.pairs.T
        expected = point.get("scale", 1.0) * before + point.get("offset", 0.0)
        return bool(np.all(np.abs(after - expected) < CONSISTENT * deviation))


def stops(sequences: Sequences, lower: np.ndarray, upper: np.ndarray, speed: np.ndarray) -> dict:
    """Stops that were met, by (joint, side), side -1 or 1.

    Args:
        sequences: Logs.
        lower: (n_joint,) limits, rad or m.
        upper: (n_joint,) limits.
        speed: (n_joint,) usual full speed, rad/s or m/s.
    """
    found = {}
    for joint in range(sequences.q.shape[-1]):
        span = float(upper[joint] - lower[joint])
        for side in (-1, 1):
            stands = _stands(sequences, joint, side, span, float(speed[joint]))
            if not stands:
                continue
            outermost = max((reading for reading, *_ in stands), key=lambda reading: side * reading)
            same = [stand for stand in stands if abs(stand[0] - outermost) < SAME_SHARE * span]
            readings, at_arrival, pushed_rows = zip(*same, strict=True)
            found[joint, side] = Stop(
                float(np.mean(readings)),
                SAME_SHARE * span,
                len(same),
                any(at_arrival) or sum(pushed_rows) >= PUSHED_ROWS,
                sum(pushed_rows),
            )
    return found


def _stands(
    sequences: Sequences, joint: int, side: int, span: float, speed: float
) -> list[tuple[float, bool, int]]:
    """Readings at which the joint arrived fast and stood, near its furthest reading.

    With each, whether it was pushed as it arrived, and for how many rows it was before it left.
    """
    out = side * sequences.q[..., joint]
    furthest = float(out[sequences.is_row].max())
    positive = np.sign(np.sum(sequences.command[..., joint] * sequences.velocity[..., joint]))
    outward = side * positive * sequences.command[..., joint]
    stands = []
    columns = (out, sequences.is_row, sequences.velocity[..., joint], outward)
    for row, is_row, velocity, pushing in zip(*columns, strict=True):
        near = (row > furthest - NEAR_SHARE * span) & is_row
        edges = np.flatnonzero(np.diff(np.concatenate([[0], near.astype(int), [0]])))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            if end - begin < STAND_ROWS or begin < 2:
                continue
            if side * velocity[begin - 2 : begin].mean() > ARRIVING_SHARE * speed:
                # Its first rows: a leaking joint creeps away from its stop.
                reading = side * float(np.median(row[begin : begin + STAND_ROWS]))
                at_arrival = bool(np.any(pushing[begin - 1 : begin + STAND_ROWS] > 0.0))
                stands.append((reading, at_arrival, int(np.sum(pushing[begin:end] > 0.0))))
    return stands


def encoders(
    nominal: Mapping[tuple[int, int], Stop],
    measured: Mapping[tuple[int, int], Stop],
    lower: np.ndarray,
    upper: np.ndarray,
) -> dict[int, Encoder]:
    """What the stops say of the encoders, for the joints that met a stop.

    Where nominal logs did not meet it, the limit of the specification stands for it.
    """
    result = {}
    for joint in range(len(lower)):
        pairs, sides = [], []
        for side, limit in ((-1, lower[joint]), (1, upper[joint])):
            after, span = measured.get((joint, side)), float(upper[joint] - lower[joint])
            if after is None:
                continue
            before = nominal.get((joint, side))
            is_there = False
            if before is None or before.n_arrivals < ARRIVALS_BEFORE:
                before = Stop(float(limit), SPECIFIED_SHARE * span, 0, False)
            else:  # one arrival where the stop has always been is no chance, if the joint was pushed into it
                is_there = abs(after.reading - before.reading) < CONSISTENT * before.deviation
            if after.is_pushed and (after.is_sure or is_there):
                deviation = float(np.hypot(before.deviation, after.deviation))
                pairs.append((before.reading, after.reading, deviation))
                sides.append(side)
        if pairs:
            result[joint] = _encoder(np.array(pairs), np.array(sides))
    return result


def encoders_of(
    nominal: Sequences, measured: Sequences, lower: np.ndarray, upper: np.ndarray, speed: np.ndarray
) -> dict[int, Encoder]:
    """As `encoders`, of whole logs; stops that move at some moment only are looked for as well.

    Args:
        nominal: Logs of the machine as it was.
        measured: Logs of the machine as it is.
        lower: (n_joint,) limits, rad or m.
        upper: (n_joint,) limits.
        speed: (n_joint,) usual full speed, rad/s or m/s.
    """
    before = stops(nominal, lower, upper, speed)

    def during(is_row: np.ndarray) -> dict[int, Encoder]:
        return encoders(before, stops(measured._replace(is_row=is_row), lower, upper, speed), lower, upper)

    result = during(measured.is_row)
    moments = np.sort(measured.stamp_ns[measured.is_row])[SMALLEST_PART_ROWS:-SMALLEST_PART_ROWS:MOMENT_ROWS]
    options: dict[int, list[Encoder]] = {}
    for moment in moments.tolist():
        is_late = measured.stamp_ns >= moment
        early, late = during(measured.is_row & ~is_late), during(measured.is_row & is_late)
        for joint, encoder in late.items():
            if encoder.errors and joint in early and early[joint].z < CONSISTENT:
                options.setdefault(joint, []).append(replace(encoder, onset=moment))
    # One moment between the last arrival at the old place and the first at the new one is as good as the other.
    return result | {joint: of_joint[len(of_joint) // 2] for joint, of_joint in options.items()}


def _encoder(pairs: np.ndarray, sides: np.ndarray) -> Encoder:
    before, after, deviation = pairs.T
    moved_in = sides * (before - after)
    inward = float(moved_in.mean()) if np.all(moved_in > 0.0) else 0.0
    z = float(np.sqrt(np.sum(((after - before) / deviation) ** 2)))
    if z < MOVED:
        return Encoder((), z, inward, pairs)
    weight = deviation**-2.0
    offset = float(weight @ (after - before) / weight.sum())
    scale = float(weight @ (after * before) / (weight @ before**2))
    options = [
        (EncoderError({"offset": offset}, float(weight.sum() ** -0.5)), after - before - offset),
        (EncoderError({"scale": scale}, float((weight @ before**2) ** -0.5)), after - scale * before),
    ]
    left = [float(weight @ rest**2) for _, rest in options]
    possible = [place for place in np.argsort(left) if left[place] <= CONSISTENT**2 * len(pairs)]
    likely = [place for place in possible if left[place] < left[possible[0]] + CONSISTENT**2]
    return Encoder(tuple(options[place][0] for place in likely), z, inward, pairs)
