"""When a statistic changed, at once or little by little, and where it is going.

    x_s  ~  t_5(μ, σ) before session v,     t_5(μ + size · g(s), σ') from v on,     g = 1 (step) or s - v + 1 (ramp)

μ and σ are those of the sessions before; size and σ' ≥ σ are fitted for each v. All v and both courses are equally
probable beforehand, so that the interval is one of the posterior with the fitted values put in.
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import t as students_t

from pipeline.watch.evidence import DEGREES

COVERAGE = 0.95
FEWEST_OF_A_TREND = 5  # sessions since the change


class Onset(NamedTuple):
    """When a change began.

    Attributes:
        first: Index of the session that it most probably began with.
        interval: Indices, both within, of the shortest run of sessions that holds 95 %.
        is_ramp: Whether it grows from session to session.
    """

    first: int
    interval: tuple[int, int]
    is_ramp: bool


class Trend(NamedTuple):
    """A line through the sessions since a change.

    Attributes:
        per_session: Growth.
        ci95: Of the growth.
        latest: Change on the line at the last session.
        reaches: Fewest and most sessions from now on until the limit, at 95 % each of the line and of the growth; None:
            the growth is not sure, there is no limit, or it is reached already.
    """

    per_session: float
    ci95: tuple[float, float]
    latest: float
    reaches: tuple[int, int] | None


def onset_of(values: np.ndarray, mean: float, deviation: float) -> Onset:
    """Find the beginning of a change.

    Args:
        values: (t,) of the statistic, NaN where a session says nothing.
        mean: Of the sessions before the watch.
        deviation: Their standard deviation.
    """
    told = np.flatnonzero(np.isfinite(values))
    off = (values[told] - mean) / deviation
    before = np.concatenate([[0.0], np.cumsum(_logpdf(off, 0.0, 1.0))])
    likelihood = np.array(
        [[before[v] + _from(off[v:], ramp) for v in range(len(told))] for ramp in (False, True)]
    )
    weight = np.exp(likelihood - likelihood.max())
    is_ramp = bool(weight[1].sum() > weight[0].sum())
    first = int(np.argmax(weight[int(is_ramp)]))
    begin, end = _shortest(weight.sum(axis=0) / weight.sum())
    return Onset(int(told[first]), (int(told[begin]), int(told[end])), is_ramp)


def _from(off: np.ndarray, is_ramp: bool) -> float:
    """Log-likelihood of the sessions since a change."""
    course = np.arange(1.0, len(off) + 1.0) if is_ramp else np.ones(len(off))
    size = off @ course / (course @ course)
    left = off - size * course
    return float(_logpdf(left, 0.0, max(1.0, float(np.sqrt(np.mean(left**2))))).sum())


def _logpdf(values: np.ndarray, place: float, scale: float) -> np.ndarray:
    return np.asarray(students_t.logpdf(values, DEGREES, place, scale))


def _shortest(weight: np.ndarray) -> tuple[int, int]:
    reached = np.concatenate([[0.0], np.cumsum(weight)])
    ends = np.searchsorted(reached, reached + COVERAGE * reached[-1] - 1e-12)
    lengths = np.where(ends < len(reached), ends - np.arange(len(reached)), len(reached) + 1)
    begin = int(np.argmin(lengths))
    return begin, max(begin, min(int(ends[begin]), len(weight)) - 1)


def trend_of(values: np.ndarray, mean: float, limit: float | None) -> Trend | None:
    """The line through the sessions since a change; None of fewer than five.

    Args:
        values: (t,) since the change; NaN where a session says nothing.
        mean: Before the change.
        limit: Size of a change up to which it is followed.
    """
    session = np.flatnonzero(np.isfinite(values))
    n = len(session)
    if n < FEWEST_OF_A_TREND:
        return None
    off = values[session] - mean
    centred = session - session.mean()
    squares = float(centred @ centred)
    slope = float(centred @ off / squares)
    left = off - off.mean() - slope * centred
    quantile = float(students_t.ppf(0.5 + COVERAGE / 2, n - 2) * np.sqrt(left @ left / (n - 2)))
    half = quantile / np.sqrt(squares)
    ahead = len(values) - 1 - float(session.mean())
    latest = float(off.mean()) + slope * ahead
    unsure = float(quantile * np.sqrt(1.0 / n + ahead**2 / squares))
    interval = slope - half, slope + half
    return Trend(slope, interval, latest, _reaches(latest, unsure, interval, limit))


def _reaches(
    latest: float, unsure: float, interval: tuple[float, float], limit: float | None
) -> tuple[int, int] | None:
    sign = float(np.sign(latest))
    slowest, fastest = sorted((sign * interval[0], sign * interval[1]))
    if limit is None or sign * latest >= limit or slowest <= 0.0:
        return None
    missing = limit - sign * latest
    return max(int(np.ceil((missing - unsure) / fastest)), 0), int(np.ceil((missing + unsure) / slowest))
