"""Frequency and damping of a joint that rings, from how it rings down after stops.

The wrapper's own fit is of all rows and of one frequency: a resonance whose frequency changes with the pose is smeared
over its poses, and fitted with too much damping. After a stop nothing drives the joint, and its velocity obeys
v_k = a_1 v_{k-1} + a_2 v_{k-2} in whatever pose it is. Noise of the encoder is in both sides, so that least squares is
biased; velocities further back, with which it has nothing in common, serve as instruments. From what all stops say
together each is then fitted by itself, for the same reason, as a decaying oscillation about a constant; of those that
ring well the median is told.

Sources: Soederstrom and Stoica (1983), Instrumental Variable Methods for System Identification, chapter 3; Golub and
Pereyra (1973), The differentiation of pseudo-inverses and nonlinear least squares problems whose variables separate.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from pipeline.discrepancy.diagnosis.sequences import Sequences

SETTLED_S = 0.3  # after the command has become zero: the drive has closed
LONGEST_S = 2.5
SHORTEST_S = 1.0  # a shorter rest tells nothing
INSTRUMENT_LAGS = (4, 5)  # neighbours share an angle's noise: three back there is still some of v_{k-2}'s
FEWEST_STOPS = 8
LOUD_PERCENTILE, LOUD_SHARE = (
    90,
    0.3,
)  # of the velocity's standard deviation over stops: what rings less is mostly noise
FEWEST_RINGING = 0.5  # of the loud stops
LARGEST_LEFT = 0.5  # of a stop's variance, when it is fitted: noise of a coarse encoder may be a third of it
BOUNDS = ((0.3, 1e-3), (8.0, 0.9))  # of frequency, Hz, and damping
POSES_SHARE = (
    0.5  # of the scatter over poses: by so much are "the" frequency and damping a matter of where one looks
)
NORMAL_MAD = 1.4826  # standard deviation of a normal variable, in units of its median absolute deviation


class RingDown(NamedTuple):
    """Of one joint in its typical pose, each with a standard deviation: of the median, and of what poses make of it."""

    frequency_hz: float
    frequency_deviation_hz: float
    damping_ratio: float
    damping_deviation: float


def ring_down(sequences: Sequences, is_used: np.ndarray, joint: int, dt_s: float) -> RingDown | None:
    """How a joint rings down; None where it does not ring, or stops too seldom to tell.

    Args:
        sequences: Logs.
        is_used: (B, T) rows that may be looked at.
        joint: Index.
        dt_s: Length of a row.
    """
    stops = _stops(sequences, is_used, joint, dt_s)
    if len(stops) < FEWEST_STOPS:
        return None
    together = _mode(np.sum([_moments(velocity) for velocity in stops], axis=0), dt_s)
    if together is None:
        return None
    loudness = np.array([np.std(velocity) for velocity in stops])
    loud = np.flatnonzero(loudness > LOUD_SHARE * np.percentile(loudness, LOUD_PERCENTILE))
    modes = [mode for mode in (_fitted(stops[index], together, dt_s) for index in loud) if mode is not None]
    if len(modes) < max(FEWEST_STOPS, FEWEST_RINGING * len(loud)):
        return None
    frequency, damping = np.transpose(modes)
    return RingDown(*_median(frequency), *_median(damping))


def _fitted(velocity: np.ndarray, start: tuple[float, float], dt_s: float) -> tuple[float, float] | None:
    """Frequency, Hz, and damping of one stop; None where a decaying oscillation explains too little of it."""
    time_s = dt_s * np.arange(len(velocity))

    def left(mode: np.ndarray) -> np.ndarray:
        omega, zeta = 2.0 * np.pi * mode[0], mode[1]
        phase = omega * np.sqrt(1.0 - zeta**2) * time_s
        decay = np.exp(-zeta * omega * time_s)
        columns = np.stack([decay * np.cos(phase), decay * np.sin(phase), np.ones_like(time_s)], axis=1)
        return velocity - columns @ np.linalg.lstsq(columns, velocity, rcond=None)[0]

    begin = np.clip(start, *BOUNDS)
    found = least_squares(left, begin, bounds=BOUNDS, x_scale=begin)
    if np.mean(found.fun**2) > LARGEST_LEFT * np.var(velocity):
        return None
    return float(found.x[0]), float(found.x[1])


def _median(values: np.ndarray) -> tuple[float, float]:
    """The median (n,) and its standard deviation, that of what poses make of it included."""
    middle = float(np.median(values))
    scatter = NORMAL_MAD * float(np.median(np.abs(values - middle)))
    of_median = np.sqrt(0.5 * np.pi / len(values)) * scatter  # asymptotic, of a normal variable
    return middle, float(np.hypot(of_median, POSES_SHARE * scatter))


def _stops(sequences: Sequences, is_used: np.ndarray, joint: int, dt_s: float) -> list[np.ndarray]:
    """Velocities after each stop."""
    at_rest = is_used & sequences.is_row & (sequences.command[..., joint] == 0.0)
    settled, longest, shortest = (round(s / dt_s) for s in (SETTLED_S, LONGEST_S, SHORTEST_S))
    found = []
    for row, rest in enumerate(at_rest):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], rest, [False]])))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            # where rows begin to be used in the midst of a rest, nobody stopped
            stopped = begin > 0 and sequences.command[row, begin - 1, joint] != 0.0
            if stopped and end - begin - settled >= shortest:
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
