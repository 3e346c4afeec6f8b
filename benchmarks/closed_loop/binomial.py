"""Exact intervals that assume no distribution."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import beta, binom

CONFIDENCE = 0.95


def clopper_pearson(successes: int, n: int) -> tuple[float, float]:
    """Two-sided 95 % interval of a probability (Clopper & Pearson, Biometrika 26, 1934); (0, 1) without trials."""
    tail = 0.5 * (1.0 - CONFIDENCE)
    lower = beta.ppf(tail, successes, n - successes + 1) if successes > 0 else 0.0
    upper = beta.ppf(1.0 - tail, successes + 1, n - successes) if successes < n else 1.0
    return float(lower), float(upper)


def median_interval(values: Sequence[float]) -> tuple[float, float]:
    """At least 95 % interval of a median from order statistics; infinite where there are too few values."""
    ordered, n = np.sort(np.asarray(values, dtype=np.float64)), len(values)
    outside = int(binom.ppf(0.5 * (1.0 - CONFIDENCE), n, 0.5)) if n else 0
    if outside == 0:  # even the extremes do not enclose the median often enough
        return -np.inf, np.inf
    return float(ordered[outside - 1]), float(ordered[n - outside])
