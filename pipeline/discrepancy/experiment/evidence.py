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

from pipeline.discrepancy.diagnosis.nominal.noise import Noise
from pipeline.discrepancy.diagnosis.scored_rows import averaged

BOUND_EXPONENT = 0.25  # of Bhattacharyya's bound, in units of E


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
