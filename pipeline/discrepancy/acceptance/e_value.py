"""E-values: evidence against there being no effect, of which 20 or more has a probability of at most 5 % there.

Source: Vovk and Wang (2021), E-values: calibration, combination and applications, Annals of Statistics 49.
"""

import numpy as np
from scipy.optimize import brentq
from scipy.stats import t

SMALLEST_P = 1e-300  # whose e-value can be held
LARGEST_P = 0.5  # of what is told from none


def e_value_of(p_value: float) -> float:
    """The mean of κ p^(κ − 1) over κ in (0, 1), whose expectation is one at most where there is no effect."""
    if p_value >= 1.0:
        return 0.5
    p = max(p_value, SMALLEST_P)
    return float((1.0 - p + p * np.log(p)) / (p * np.log(p) ** 2))


def smallest_t(e_value: float, freedom: float) -> float:
    """Student's t from which on its e-value is so large.

    Args:
        e_value: Above 1.
        freedom: Degrees of freedom.
    """
    log_p = brentq(lambda of: np.log(e_value_of(np.exp(of)) / e_value), np.log(SMALLEST_P), np.log(LARGEST_P))
    return float(t.isf(np.exp(log_p), freedom))


def as_told(e_value: float) -> dict[str, float]:
    """As in closed_loop.json, with the p-value that it is (contract, section 4)."""
    return {"e_value": e_value, "p_value": min(1.0, 1.0 / e_value)}
