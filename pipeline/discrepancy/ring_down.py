"""Frequency and damping of a joint that rings, from how it rings down after stops.

The wrapper's own fit is of all rows and of one frequency: a resonance whose frequency changes with the pose is smeared
over its poses, and fitted with too much damping. After a stop nothing drives the joint, and its velocity obeys
v_k = a_1 v_{k-1} + a_2 v_{k-2} in whatever pose it is. Noise of the encoder is in both sides, so that least squares is
biased; velocities further back, with which it has nothing in common, serve as instruments.

Source: Soederstrom and Stoica (1983), Instrumental Variable Methods for System Identification, chapter 3.
"""

from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.sequences import Sequences

SETTLED_S = 0.3  # after the command has become zero: the drive has closed
LONGEST_S = 2.5
SHORTEST_S = 1.0  # a shorter rest tells nothing
INSTRUMENT_LAGS = (4, 5)  # neighbours share an angle's noise: three back there is still some of v_{k-2}'s
FEWEST_STOPS = 8
RESAMPLES = 200


class RingDown(NamedTuple):
    """Of one joint, each with its standard deviation by resampling of stops."""

    frequency_hz: float
    frequency_deviation_hz: float
    damping_ratio: float
    damping_deviation: float


def ring_down(
    sequences: Sequences, is_used: np.ndarray, joint: int, dt_s: float, seed: int
) -> RingDown | None:
    """How a joint rings down; None where it does not ring, or stops too seldom to tell.

    Args:
        sequences: Logs.
        is_used: (B, T) rows that may be looked at.
        joint: Index.
        dt_s: Length of a row.
        seed: Of the resampling.
    """
    stops = _stops(sequences, is_used, joint, dt_s)
    if len(stops) < FEWEST_STOPS:
        return None
    moments = np.array([_moments(velocity) for velocity in stops])  # (n_stops, 2, 3)
    found = _mode(moments.sum(axis=0), dt_s)
    if found is None:
        return None
    random = np.random.default_rng(seed)
    drawn = [
        _mode(moments[random.integers(len(moments), size=len(moments))].sum(axis=0), dt_s)
        for _ in range(RESAMPLES)
    ]
    spread = np.std([mode for mode in drawn if mode is not None], axis=0)
    return RingDown(found[0], float(spread[0]), found[1], float(spread[1]))


def _stops(sequences: Sequences, is_used: np.ndarray, joint: int, dt_s: float) -> list[np.ndarray]:
    """Velocities after each stop."""
    at_rest = is_used & sequences.is_row & (sequences.command[..., joint] == 0.0)
    settled, longest, shortest = (round(s / dt_s) for s in (SETTLED_S, LONGEST_S, SHORTEST_S))
    found = []
    for row, rest in enumerate(at_rest):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], rest, [False]])))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            if begin > 0 and end - begin - settled >= shortest:
                found.append(sequences.velocity[row, begin + settled : min(end, begin + longest), joint])
    return found


def _moments(velocity: np.ndarray) -> np.ndarray:
    """Sums of instruments times (v_{k-1}, v_{k-2}, v_k), (2, 3)."""
    first = max(INSTRUMENT_LAGS)
    now = np.arange(first, len(velocity))
    instruments = np.stack([velocity[now - lag] for lag in INSTRUMENT_LAGS])
    return instruments @ np.stack([velocity[now - 1], velocity[now - 2], velocity[now]], axis=1)


def _mode(moments: np.ndarray, dt_s: float) -> tuple[float, float] | None:
    """Natural frequency, Hz, and damping ratio of the pair of poles; None if they do not oscillate."""
    try:
        first, second = np.linalg.solve(moments[:, :2], moments[:, 2])
    except np.linalg.LinAlgError:
        return None
    pole = np.roots([1.0, -first, -second])[0]
    if pole.imag == 0.0 or abs(pole) >= 1.0:
        return None
    exponent = np.log(complex(pole)) / dt_s
    return abs(exponent) / (2.0 * np.pi), float(-exponent.real / abs(exponent))
