"""Which parts of a range nominal logs hold: elsewhere a model extrapolates, and what it is off there means little."""

import numpy as np

from pipeline.effects.effect import SMALLEST_COMMAND

PARTS_OF_COMMAND = 20  # of [-1, 1]
SELDOM_SHARE = 0.01  # of the nominal rows on which the joint is commanded, per part


def is_often(known: np.ndarray, asked: np.ndarray, edges: np.ndarray, smallest_share: float) -> np.ndarray:
    """Whether values lie in a part of their range that holds its share of the known ones.

    Args:
        known: (N,) values.
        asked: (...,) values.
        edges: (n_part + 1,) of the parts, rising; what lies beyond belongs to the outermost.
        smallest_share: Of the known values, and one of them at least, for a part to be known.

    Returns:
        (...,) bool.
    """
    inner = edges[1:-1]
    counts = np.bincount(np.digitize(known, inner), minlength=len(edges) - 1)
    return (counts >= max(smallest_share * len(known), 1))[np.digitize(asked, inner)]


def uncovered_share(nominal: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Per joint, the share of measured commands that lie where nominal logs seldom command it.

    Args:
        nominal: (N, n_joint) proportional commands in [-1, 1].
        measured: (M, n_joint).

    Returns:
        (n_joint,) of the measured rows on which the joint is commanded; 0 where there are none.
    """
    # as joysticks quantise commands: to decimals, on which an edge has to lie exactly
    edges = np.round(np.linspace(-1.0, 1.0, PARTS_OF_COMMAND + 1), 6)
    nominal, measured = (np.round(commands, 6) for commands in (nominal, measured))
    shares = np.zeros(nominal.shape[1])
    for joint in range(nominal.shape[1]):
        known, asked = (
            commands[:, joint][np.abs(commands[:, joint]) > SMALLEST_COMMAND]
            for commands in (nominal, measured)
        )
        if len(asked):
            shares[joint] = 1.0 - float(np.mean(is_often(known, asked, edges, SELDOM_SHARE)))
    return shares
