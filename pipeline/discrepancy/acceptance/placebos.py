"""Placebos: changes of the size of an effect's that are not the effect, and how often they explain as much.

They act at the wrong time, in the wrong order, or on the wrong joint.
"""

from collections.abc import Callable

import numpy as np
from scipy.special import ndtr

PLACEBOS = 200
PIECE_ROWS, FEWEST_PIECES = 100, 6  # of a change that is permuted, longer than a motion
MOST_ALIKE = 0.4


def placebo_p(residual: np.ndarray, change: np.ndarray, n_hypotheses: int, seed: int) -> float:
    """How probable so large a gain is for a change of the same size at the wrong time.

    The change that the effect makes is shifted in time (cyclically), or its pieces are put in another order, and scaled
    to fit best; the gain's distribution over shifts, and over orders, is taken for normal beyond what can be counted,
    and the larger of both is corrected for all hypotheses searched (Bonferroni).

    Args:
        residual: (N,) without the effect.
        change: (N,) of the velocity by the effect.
        n_hypotheses: Number of hypotheses searched.
        seed: Of the shifts.
    """
    square = float(change @ change)
    if square <= 0.0:
        return 1.0

    def root_gain(shift: int) -> float:
        return float(np.roll(change, shift) @ residual) / np.sqrt(square)

    p = max(shifted_p(root_gain, len(residual), seed), _permuted_p(residual, change, seed))
    return float(np.clip(p * n_hypotheses, np.finfo(float).tiny, 1.0))


def shifted_p(root_gain: Callable[[int], float], n_rows: int, seed: int) -> float:
    """How far a root gain without shift in time lies beyond those with shifts, taken for normal, as a probability.

    Args:
        root_gain: Of what explains, shifted by so many rows (cyclically).
        n_rows: Rows along which it is shifted: by a twentieth of them at least, either way.
        seed: Of the shifts.
    """
    shifts = np.random.default_rng(seed).integers(n_rows // 20, n_rows - n_rows // 20, PLACEBOS)
    return _beyond(root_gain(0), np.array([root_gain(int(shift)) for shift in shifts]))


def _permuted_p(residual: np.ndarray, change: np.ndarray, seed: int) -> float:
    """The same of the pieces of a change in any other order."""
    n_pieces = len(change) // PIECE_ROWS
    if n_pieces < FEWEST_PIECES:
        return 0.0
    random = np.random.default_rng(seed)
    kept = slice(0, n_pieces * PIECE_ROWS)
    # by all pairs of a piece of the change and one of the residual
    products = change[kept].reshape(n_pieces, -1) @ residual[kept].reshape(n_pieces, -1).T
    orders = np.array([random.permutation(n_pieces) for _ in range(PLACEBOS)])
    placebos = products[orders, np.arange(n_pieces)].sum(axis=1)
    return _beyond(float(np.trace(products)), placebos)


def _beyond(value: float, placebos: np.ndarray) -> float:
    """How probable so large a value is among placebos, were they normal."""
    return float(ndtr(-(value - placebos.mean()) / max(float(placebos.std()), 1e-12)))


def explains_other_joints(change: np.ndarray, residual: np.ndarray, left: np.ndarray, joint: int) -> bool:
    """Whether the change that an effect makes on its joint explains what is left of another joint as well, or better.

    Args:
        change: (N,) of the joint's velocity by the effect.
        residual: (N, n_joint) without the effect, each joint in units of its noise floor's root.
        left: (N, n_joint) with all effects, in the same units.
        joint: The effect's.
    """
    others = np.delete(left, joint, axis=1)
    on_others = np.abs(change @ others)
    return bool(len(on_others) and on_others.max() >= change @ residual[:, joint])


def can_be_shifted(change: np.ndarray) -> bool:
    """Whether a change of the velocity varies so much in time that, shifted, it is another.

    A creep at rest is nearly the same everywhere: shifted in time it explains as much as where it belongs.
    """
    n = len(change)
    square = float(change @ change)
    likeness = [
        float(np.roll(change, shift) @ change) / max(square, 1e-12) for shift in range(n // 10, n, n // 10)
    ]
    return float(np.mean(likeness)) < MOST_ALIKE
