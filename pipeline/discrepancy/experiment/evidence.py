"""The evidence that a manoeuvre is expected to give between two explanations, and its sum over manoeuvres.

Explanation a predicts velocities v_a. If a is true, the logarithm of the likelihood ratio of a to b is expected to be

    E_ab = min_β ½ ‖ v_a − v_b − X β ‖² + ½ ‖β‖²,

with velocities in units of the noise. X holds what b's values do to them, and what the machine does not repeat
exactly, each in units of its deviation: b may adapt its values to a, as in the T-optimal designs of Atkinson and
Fedorov (1975, Biometrika 62). The sums in it add up over manoeuvres:

    E_ab = ½ (D − cᵀ (G + I)⁻¹ c),   D = Σ dᵀd,  c = Σ Xᵀd,  G = Σ XᵀX,  d = v_a − v_b.

To take b for a has a probability of at most e^(−E_ab / 4) (Bhattacharyya; two normal distributions of one covariance).
The sum of these bounds over all pairs is what a plan makes small. Review: Chaloner and Verdinelli (1995, Statistical
Science 10).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.diagnosis.nominal_behaviour import NominalBehaviour
from pipeline.discrepancy.diagnosis.scored_rows import ROWS_AVERAGED, averaged
from pipeline.discrepancy.diagnosis.simulation import NOMINAL
from pipeline.dynamics.model.shown_motion import STANDING_SHARE

LONGEST_CORRELATION_S = 2.0  # that is looked for: some rise times of a joint
BOUND_EXPONENT = 0.25  # of Bhattacharyya's bound, in units of E


class Noise(NamedTuple):
    """What the model is off by on nominal logs that it did not see.

    Attributes:
        moving: (n_joint,) standard deviation of averaged velocities while the joint moves, rad/s (m/s).
        standing: (n_joint,) the same at rest.
        correlated: (n_joint,) rows that count as one, since errors follow one another.
        unrepeated: (n_joint,) standard deviation of speeds from log to log, as a share.
    """

    moving: np.ndarray
    standing: np.ndarray
    correlated: np.ndarray
    unrepeated: np.ndarray


def noise_of(nominal: NominalBehaviour, dt_s: float) -> Noise:
    """Of the nominal logs."""
    sequences, rows = nominal.simulation.sequences, nominal.rows
    expected = nominal.simulation.velocities([NOMINAL])[0]
    v = rows.averaged(expected)
    residual = rows.weight * (rows.averaged(sequences.velocity) - v)
    number = np.broadcast_to(np.arange(len(sequences.q))[:, None], sequences.is_row.shape)
    log = rows.averaged(number.astype(float))
    n_joint = v.shape[1]
    moving, standing, correlated, unrepeated = (np.zeros(n_joint) for _ in range(4))
    longest = max(round(LONGEST_CORRELATION_S / dt_s) // ROWS_AVERAGED, 1)
    for joint in range(n_joint):
        counts = rows.weight[:, joint] > 0.0
        moves = np.abs(v[:, joint]) > STANDING_SHARE * nominal.setting.speed_scale[joint]
        r = residual[:, joint]
        at_rest = np.sqrt(nominal.floor[joint] * nominal.at_rest[joint])
        moving[joint] = max(np.sqrt(np.mean(r[counts & moves] ** 2)), at_rest)
        standing[joint] = at_rest
        correlated[joint] = _correlated_rows(r[counts & moves], longest)
        slopes = [
            float(np.sum(r[of] * v[of, joint]) / np.sum(v[of, joint] ** 2))
            for one in np.unique(log)
            if (of := counts & moves & (log == one)).sum() > longest
        ]
        unrepeated[joint] = np.std(slopes, ddof=1) if len(slopes) > 1 else 0.0
    return Noise(moving, standing, correlated, unrepeated)


def _correlated_rows(r: np.ndarray, longest: int) -> float:
    """Integrated autocorrelation up to the first lag that is not positive (Geyer 1992, Statistical Science 7)."""
    r = r - r.mean()
    squares = float(np.mean(r**2))
    total = 1.0
    for lag in range(1, longest + 1):
        rho = float(np.mean(r[lag:] * r[:-lag])) / squares
        if rho <= 0.0:
            break
        total += 2.0 * rho
    return total


class PairSums(NamedTuple):
    """D, c and G of one pair, which add up over manoeuvres: (), (P,), (P, P)."""

    d: float
    c: np.ndarray
    g: np.ndarray

    def evidence(self) -> float:
        """E of the pair."""
        p = len(self.c)
        return 0.5 * float(self.d - self.c @ np.linalg.solve(self.g + np.eye(p), self.c))

    def plus(self, other: "PairSums") -> "PairSums":
        """With another manoeuvre's."""
        return PairSums(self.d + other.d, self.c + other.c, self.g + other.g)

    def times(self, n: float) -> "PairSums":
        """Of a manoeuvre that is played so often."""
        return PairSums(n * self.d, n * self.c, n * self.g)


def pair_sums(
    true: np.ndarray, rival: np.ndarray, columns: Sequence[np.ndarray], known: np.ndarray, noise: Noise
) -> PairSums:
    """Sums over the rows of a manoeuvre.

    Args:
        true: (T, n_joint) velocities by the explanation taken to be true, rad/s (m/s).
        rival: (T, n_joint) by the other one.
        columns: What else changes velocities by (T, n_joint), per deviation.
        known: (T, n_joint) bool: rows on which nominal logs say how a joint moves.
        noise: Of averaged velocities.
    """
    moves = np.maximum(np.abs(_averaged(true)), np.abs(_averaged(rival))) > noise.standing
    scale = np.where(moves, noise.moving, noise.standing) * np.sqrt(noise.correlated)
    counts = _averaged(known.astype(float)) > 1.0 - 1e-9
    of_rows = counts / scale
    difference = (_averaged(true - rival) * of_rows).ravel()
    speed = _averaged(true) * noise.unrepeated
    unrepeated = [np.where(np.arange(len(noise.moving)) == j, speed, 0.0) for j in range(len(noise.moving))]
    x = np.stack(
        [*((_averaged(c) * of_rows).ravel() for c in columns), *((u * of_rows).ravel() for u in unrepeated)]
    )
    return PairSums(float(difference @ difference), x @ difference, x @ x.T)


def _averaged(values: np.ndarray) -> np.ndarray:
    """(T, n_joint) of a manoeuvre, all of whose rows count."""
    return averaged(values[None], np.ones((1, len(values)), bool))


def log_error_bound(sums: Sequence[PairSums]) -> float:
    """Logarithm of the sum of the pairs' bounds on the probability of error."""
    return float(np.logaddexp.reduce([-BOUND_EXPONENT * of.evidence() for of in sums]))
