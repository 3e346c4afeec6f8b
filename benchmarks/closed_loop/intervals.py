"""95 % intervals of what is counted or measured on machines, each of which may give several values."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import beta

CONFIDENCE = 0.95
N_RESAMPLE, SEED = 2000, 50
TAIL = 0.5 * (1.0 - CONFIDENCE)

Values = Sequence[Sequence[float]]
"""By machine."""


def clopper_pearson(successes: int, n: int) -> tuple[float, float]:
    """Exact two-sided interval of a probability (Clopper & Pearson, Biometrika 26, 1934); (0, 1) without trials."""
    lower = beta.ppf(TAIL, successes, n - successes + 1) if successes > 0 else 0.0
    upper = beta.ppf(1.0 - TAIL, successes + 1, n - successes) if successes < n else 1.0
    return float(lower), float(upper)


def over_machines(values: Values, statistic: Callable[[np.ndarray], float]) -> tuple[float, float]:
    """Percentile bootstrap that draws machines, with all that they gave (Davison & Hinkley, 1997, section 3.8)."""
    groups = [np.asarray(of, dtype=np.float64) for of in values if len(of)]
    random = np.random.default_rng(SEED)
    drawn = random.integers(len(groups), size=(N_RESAMPLE, len(groups)))
    resampled = [statistic(np.concatenate([groups[i] for i in row])) for row in drawn]
    lower, upper = np.quantile(resampled, (TAIL, 1.0 - TAIL))
    return float(lower), float(upper)


def share_interval(hits: Sequence[Sequence[bool]]) -> tuple[float, float]:
    """Of a share. Where machines give one trial each, or all trials went alike, it is exact over machines."""
    groups = [list(of) for of in hits if len(of)]
    flat = [hit for of in groups for hit in of]
    if all(len(of) == 1 for of in groups) or len(set(flat)) == 1:
        n = len(groups)
        return clopper_pearson(round(n * sum(flat) / max(len(flat), 1)), n)
    return over_machines(groups, lambda drawn: float(drawn.mean()))
