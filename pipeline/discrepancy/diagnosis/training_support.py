"""Which parts of a range nominal logs hold: elsewhere a model extrapolates, and what it is off there means little."""

import numpy as np

from pipeline.discrepancy.diagnosis.sequences import Sequences
from pipeline.dynamics.model.shown_motion import STANDING_SHARE
from pipeline.effects.effect import SMALLEST_COMMAND, Setting

PARTS_OF_RANGE = 20
SMALLEST_VISITS_SHARE = 0.008  # of moving rows, per part of the range
SMALLEST_TOGETHER_SHARE = 0.002  # of moving rows, per number of joints that are commanded at once

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


def is_known(nominal: Sequences, sequences: Sequences, setting: Setting, is_switched: bool) -> np.ndarray:
    """Where nominal logs show how a joint moves, (B, T, n_joint).

    It stands in a part of its range that it often moved through, and, of a machine with switches, as many joints are
    commanded as sometimes were while it moved. Elsewhere the diagnosis model extrapolates, and what it is off there is
    no sign of an effect.
    """
    result = np.zeros(sequences.q.shape, bool)
    together, asked_together = (np.abs(of.command).sum(axis=-1) for of in (nominal, sequences))
    numbers = np.arange(nominal.command.shape[-1] + 2) - 0.5
    for joint in range(nominal.q.shape[-1]):
        edges = np.linspace(setting.lower[joint], setting.upper[joint], PARTS_OF_RANGE + 1)
        moving = nominal.is_row & (
            np.abs(nominal.velocity[..., joint]) > STANDING_SHARE * setting.speed_scale[joint]
        )
        asked = sequences.q[..., joint]
        result[..., joint] = is_often(nominal.q[..., joint][moving], asked, edges, SMALLEST_VISITS_SHARE)
        asks = np.abs(sequences.command[..., joint]) > 0.0
        if is_switched:
            known = is_often(together[moving], asked_together, numbers, SMALLEST_TOGETHER_SHARE)
            result[..., joint] &= known | ~asks
    return result
