"""The noise of a joint's residual: its size in each state, its correlation in time, and its heavy tails.

    r_t = s_{state(t)} z_t,     z_t = Σ_k φ_k z_{t-k} + e_t,     e_t ~ Student's t of ν degrees of freedom

All of it is learned from nominal rows, which the members of the model did not see. Source: generalised least squares
with autoregressive errors, Hamilton (1994), Time Series Analysis, chapter 8; heavy tails: Lange, Little and Taylor
(1989), Robust statistical modeling using the t distribution.
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import t as students_t

from pipeline.discrepancy.posterior.rows import N_STATE

LAGS = 3  # scored rows, 0.3 s: what an ensemble that predicts from commands alone leaves of a start
DEGREES = (2.5, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 30.0, 100.0)
SCALES = np.geomspace(0.3, 1.2, 12)
FEWEST_ROWS = 10  # of a state, or its size is that of all
LEAST_OF_ALL = 0.01  # of the size of all rows: encoders resolve no less


class Noise(NamedTuple):
    """Of one joint.

    Attributes:
        size: (N_STATE,) standard deviation in each state [rad/s, m/s].
        correlation: (LAGS,) φ.
        innovation: Standard deviation of e.
        degrees: ν.
        scale: Of Student's t, in units of `innovation`.
    """

    size: np.ndarray
    correlation: np.ndarray
    innovation: float
    degrees: float
    scale: float

    def whiten(self, values: np.ndarray, state: np.ndarray, run: np.ndarray) -> np.ndarray:
        """(N, k) values to (N, k) in units of the innovation; the first rows of a run, which lack a past, are 0."""
        scaled = values / self.size[state][:, None].astype(values.dtype)
        result = scaled.copy()
        for k, of in enumerate(self.correlation.astype(values.dtype), start=1):
            result[k:] -= of * scaled[:-k]
        result[~has_past(run)] = 0.0
        return result / values.dtype.type(self.innovation)


def has_past(run: np.ndarray) -> np.ndarray:
    """(N,) whether the rows before it that the correlation asks for are of the same run."""
    return np.concatenate([np.zeros(LAGS, bool), run[LAGS:] == run[:-LAGS]])


def learn_noise(residual: np.ndarray, state: np.ndarray, run: np.ndarray, counts: np.ndarray) -> Noise:
    """Fit the noise of one joint.

    Args:
        residual: (N,) on nominal rows.
        state: (N,) of each row.
        run: (N,) number of its stretch.
        counts: (N,) bool, whether the joint counts there.
    """
    overall = max(float(np.mean(residual[counts] ** 2)) if counts.any() else 0.0, 1e-18)
    size = np.empty(N_STATE)
    for index in range(N_STATE):
        of = residual[counts & (state == index)]
        own = float(np.mean(of**2)) if len(of) >= FEWEST_ROWS else overall
        size[index] = np.sqrt(max(own, LEAST_OF_ALL**2 * overall))
    scaled = residual / size[state]
    usable = has_past(run) & counts
    past = np.stack([np.roll(scaled, k)[usable] for k in range(1, LAGS + 1)], axis=1)
    present = scaled[usable]
    gram = past.T @ past + 1e-6 * max(len(present), 1) * np.eye(LAGS)
    correlation = np.linalg.solve(gram, past.T @ present)
    left = present - past @ correlation
    innovation = float(np.sqrt(np.mean(left**2) + 1e-12)) if len(left) else 1.0
    degrees, scale = _tails(left / innovation) if len(left) else (DEGREES[-1], 1.0)
    return Noise(size, correlation, innovation, degrees, scale)


def _tails(values: np.ndarray) -> tuple[float, float]:
    """Degrees of freedom and scale of greatest likelihood on a grid."""
    likelihood = {
        (degrees, float(scale)): float(np.mean(students_t.logpdf(values / scale, degrees)) - np.log(scale))
        for degrees in DEGREES
        for scale in SCALES
    }
    return max(likelihood, key=lambda key: likelihood[key])
