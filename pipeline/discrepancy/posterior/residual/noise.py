"""The noise of a joint's residual: its size in each state, its correlation in time, its heavy tails; and each motion.

    r_t = s_{state(t)} z_t + u_t c_{motion(t)},     z_t = Σ_k φ_k z_{t-k} + e_t,     c ~ N(0, σ²)

e_t has Student's t of ν degrees of freedom. σ is that of most motions: a few that hardly resemble their prediction,
such as creeping ones, count as outliers. A motion lasts as long as the predicted velocity u keeps its sign; its
speed is off by c. All is learned from nominal rows, which the members of the model did not see. Source: generalised
least squares with autoregressive errors, Hamilton (1994), Time Series Analysis, chapter 8; random effects: Laird and
Ware (1982), Random-effects models for longitudinal data; heavy tails: Lange, Little and Taylor (1989), Robust
statistical modeling using the t distribution.
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import t as students_t

from pipeline.discrepancy.posterior.residual.rows import N_STATE

LAGS = 3  # scored rows, 0.3 s: what an ensemble that predicts from commands alone leaves of a start
DEGREES = (2.5, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 30.0, 100.0)
SCALES = np.geomspace(0.3, 1.2, 12)
OF_MOTIONS = (0.0, *np.geomspace(0.005, 0.5, 14).tolist())  # σ that are tried: a factor of 1.4 apart
# Of Student's t when σ is fitted, as Lange, Little and Taylor advise; of this scale it is fitted best by normal values
# of standard deviation one.
DEGREES_OF_MOTIONS, SCALE_OF_MOTIONS = 4.0, 0.831
FEWEST_ROWS = 10  # of a state, or its size is that of all
LEAST_OF_ALL = 0.01  # of the size of all rows: encoders resolve no less


class Noise(NamedTuple):
    """Of one joint.

    Attributes:
        size: (N_STATE,) standard deviation in each state [rad/s, m/s].
        correlation: (LAGS,) φ.
        innovation: Standard deviation of e.
        of_motions: σ, relative to the speed.
        degrees: ν.
        scale: Of Student's t, in units of `innovation`.
    """

    size: np.ndarray
    correlation: np.ndarray
    innovation: float
    of_motions: float
    degrees: float
    scale: float

    def whiten(
        self, values: np.ndarray, state: np.ndarray, run: np.ndarray, velocity: np.ndarray
    ) -> np.ndarray:
        """(N, k) values to (N, k) in units of the innovation; the first rows of a run, which lack a past, are 0.

        Args:
            values: Residuals, or what is added to them.
            state: (N,) of each row.
            run: (N,) number of its stretch.
            velocity: (N,) predicted; 0 where the joint does not count.
        """
        white = self._less_past(values, state, run)
        if self.of_motions == 0.0:
            return white
        speed = self._less_past(velocity[:, None].astype(values.dtype), state, run)
        motion = motions(velocity, run)
        squares, products = _sums(speed**2, motion), _sums(speed * white, motion)
        # The inverse root of 1 + σ² u uᵀ, motion by motion.
        share = (1.0 - 1.0 / np.sqrt(1.0 + self.of_motions**2 * squares)) / np.maximum(squares, 1e-12)
        return white - speed * (share * products)[motion].astype(values.dtype)

    def _less_past(self, values: np.ndarray, state: np.ndarray, run: np.ndarray) -> np.ndarray:
        scaled = values / self.size[state][:, None].astype(values.dtype)
        result = scaled.copy()
        for k, of in enumerate(self.correlation.astype(values.dtype), start=1):
            result[k:] -= of * scaled[:-k]
        result[~has_past(run)] = 0.0
        return result / values.dtype.type(self.innovation)


def motions(velocity: np.ndarray, run: np.ndarray) -> np.ndarray:
    """(N,) numbers of stretches of one run in which the velocity (N,) keeps its sign."""
    ends = (np.diff(np.sign(velocity)) != 0) | (np.diff(run) != 0)
    return np.concatenate([[0], np.cumsum(ends)])


def _sums(values: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """(n, k) sums of values (N, k) over each motion."""
    begins = np.flatnonzero(np.diff(motion, prepend=-1))
    return np.add.reduceat(values, begins, axis=0, dtype=float)


def has_past(run: np.ndarray) -> np.ndarray:
    """(N,) whether the rows before it that the correlation asks for are of the same run."""
    return np.concatenate([np.zeros(LAGS, bool), run[LAGS:] == run[:-LAGS]])


def learn_noise(
    residual: np.ndarray, state: np.ndarray, run: np.ndarray, counts: np.ndarray, velocity: np.ndarray
) -> Noise:
    """Fit the noise of one joint.

    Args:
        residual: (N,) on nominal rows.
        state: (N,) of each row.
        run: (N,) number of its stretch.
        counts: (N,) bool, whether the joint counts there.
        velocity: (N,) predicted; 0 where the joint does not count.
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
    noise = Noise(size, correlation, innovation, 0.0, DEGREES[-1], 1.0)
    if not len(left):
        return noise
    # What motions have of their own was part of the innovation: both once more.
    for _ in range(2):
        noise = noise._replace(of_motions=_of_motions(noise, residual, state, run, velocity))
        white = noise.whiten(residual[:, None], state, run, velocity)[usable, 0]
        noise = noise._replace(innovation=noise.innovation * float(np.sqrt(np.mean(white**2) + 1e-12)))
    white = noise.whiten(residual[:, None], state, run, velocity)[usable, 0]
    degrees, scale = _tails(white)
    return noise._replace(degrees=degrees, scale=scale)


def _of_motions(
    noise: Noise, residual: np.ndarray, state: np.ndarray, run: np.ndarray, velocity: np.ndarray
) -> float:
    """The σ of greatest likelihood; arguments as of `learn_noise`."""
    both = noise._replace(of_motions=0.0).whiten(np.column_stack([residual, velocity]), state, run, velocity)
    product, square = _sums(both * both[:, 1:], motions(velocity, run)).T
    told = square > 0.0
    score, square = product[told] / np.sqrt(square[told]), square[told]
    scales = [SCALE_OF_MOTIONS * np.sqrt(1.0 + sigma**2 * square) for sigma in OF_MOTIONS]
    of = [
        float(np.sum(students_t.logpdf(score / scale, DEGREES_OF_MOTIONS) - np.log(scale)))
        for scale in scales
    ]
    return OF_MOTIONS[int(np.argmax(of))]


def _tails(values: np.ndarray) -> tuple[float, float]:
    """Degrees of freedom and scale of greatest likelihood on a grid."""
    likelihood = {
        (degrees, float(scale)): float(np.mean(students_t.logpdf(values / scale, degrees)) - np.log(scale))
        for degrees in DEGREES
        for scale in SCALES
    }
    return max(likelihood, key=lambda key: likelihood[key])
