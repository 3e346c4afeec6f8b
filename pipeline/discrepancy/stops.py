"""Where a joint comes to a stand at its mechanical stops: the one place where an encoder can be checked by itself.

A joint that arrives fast and then stands, at the same reading time after time, has met its stop. Stops do not move;
where their reading does, it is the encoder's offset or scale, and where it does not, no encoder's error may explain
what else has changed.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.sequences import Sequences

NEAR_SHARE = 0.004  # of the range: around the furthest reading
SAME_SHARE = 0.0015  # of the range: readings of the same stop, medians over the first rows of a stand
STAND_ROWS = 4
ARRIVING_SHARE = 0.4  # of the usual speed, just before the stand: faster than a joint that was let go
ARRIVALS_BEFORE = 2  # at the same reading in nominal logs; once may be chance
ARRIVALS_AFTER = 3  # at the same reading elsewhere: more is claimed with it
SPECIFIED_SHARE = 0.01  # of the range: how well a limit of the specification is known as a reading
MOVED = 5.0  # standard deviations
CONSISTENT = 3.0


@dataclass(frozen=True)
class Stop:
    """A stop as the encoder reads it.

    Attributes:
        reading: rad or m.
        deviation: Of the reading.
        n_arrivals: How often it was met.
    """

    reading: float
    deviation: float
    n_arrivals: int


@dataclass(frozen=True)
class Encoder:
    """What the stops say of one joint's encoder.

    Attributes:
        point: Parameter of `sensor_bias` that moves the stops as they moved; None: they have not moved.
        deviation: Standard deviation of that parameter.
        z: How many standard deviations the stops are off their places.
        inward: How far the stops have moved towards the middle, rad or m: play in the linkage moves them so, by half of
            it; 0 if any has moved outward.
        pairs: (n, 3) readings before and after, and their deviation.
    """

    point: Mapping[str, float] | None
    deviation: float
    z: float
    inward: float
    pairs: np.ndarray

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
            readings = _stands(sequences, joint, side, span, float(speed[joint]))
            if not readings:
                continue
            outermost = max(readings, key=lambda reading: side * reading)
            same = [r for r in readings if abs(r - outermost) < SAME_SHARE * span]
            found[joint, side] = Stop(float(np.mean(same)), SAME_SHARE * span, len(same))
    return found


def _stands(sequences: Sequences, joint: int, side: int, span: float, speed: float) -> list[float]:
    """Readings at which the joint arrived fast and stood, near its furthest reading."""
    out = side * sequences.q[..., joint]
    furthest = float(out[sequences.is_row].max())
    readings = []
    for row, is_row, velocity in zip(out, sequences.is_row, sequences.velocity[..., joint], strict=True):
        near = (row > furthest - NEAR_SHARE * span) & is_row
        edges = np.flatnonzero(np.diff(np.concatenate([[0], near.astype(int), [0]])))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            if end - begin < STAND_ROWS or begin < 2:
                continue
            if side * velocity[begin - 2 : begin].mean() > ARRIVING_SHARE * speed:
                # Its first rows: a leaking joint creeps away from its stop.
                readings.append(side * float(np.median(row[begin : begin + STAND_ROWS])))
    return readings


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
                before = Stop(float(limit), SPECIFIED_SHARE * span, 0)
            else:  # one arrival where the stop has always been is no chance
                is_there = abs(after.reading - before.reading) < CONSISTENT * before.deviation
            if after.n_arrivals >= ARRIVALS_AFTER or is_there:
                deviation = float(np.hypot(before.deviation, after.deviation))
                pairs.append((before.reading, after.reading, deviation))
                sides.append(side)
        if pairs:
            result[joint] = _encoder(np.array(pairs), np.array(sides))
    return result


def _encoder(pairs: np.ndarray, sides: np.ndarray) -> Encoder:
    before, after, deviation = pairs.T
    moved_in = sides * (before - after)
    inward = float(moved_in.mean()) if np.all(moved_in > 0.0) else 0.0
    z = float(np.sqrt(np.sum(((after - before) / deviation) ** 2)))
    if z < MOVED:
        return Encoder(None, 0.0, z, inward, pairs)
    weight = deviation**-2.0
    offset = float(weight @ (after - before) / weight.sum())
    scale = float(weight @ (after * before) / (weight @ before**2))
    options = [
        ({"offset": offset}, weight.sum() ** -0.5, after - before - offset),
        ({"scale": scale}, (weight @ before**2) ** -0.5, after - scale * before),
    ]
    point, spread, left = min(options, key=lambda option: float(weight @ option[2] ** 2))
    if float(weight @ left**2) > CONSISTENT**2 * len(pairs):
        return Encoder(None, 0.0, z, inward, pairs)  # moved, but as no single error of an encoder moves them
    return Encoder(point, float(spread), z, inward, pairs)
