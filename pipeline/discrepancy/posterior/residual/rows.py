"""What is known of each scored row besides residual and columns."""

from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ROWS_AVERAGED, ScoredRows, averaged
from pipeline.discrepancy.diagnosis.sequences import Sequences

SETTLED_ROWS = (
    8  # scored rows after a change of command in which a joint is still speeding up or slowing down
)
SMALLEST_CHANGE = 0.05  # of a command
MOVING_SHARE = 0.05  # of a joint's usual speed
N_STATE = 3
AT_REST, CHANGING, MOVING = range(N_STATE)


class RowFacts(NamedTuple):
    """Of N scored rows.

    Attributes:
        session: (N,) number of the log.
        run: (N,) number of the stretch without a gap.
        stamp_ns: (N,) absolute.
        state: (N, n_joint) `AT_REST`, `CHANGING` or `MOVING`.
    """

    session: np.ndarray
    run: np.ndarray
    stamp_ns: np.ndarray
    state: np.ndarray


def facts_of(
    sequences: Sequences,
    rows: ScoredRows,
    velocity: np.ndarray,
    speed_scale: np.ndarray,
    purpose: np.ndarray | None = None,
) -> RowFacts:
    """Facts of the rows in use.

    Args:
        sequences: Of the logs.
        rows: In use.
        velocity: (N, n_joint) predicted without effects.
        speed_scale: (n_joint,) a joint's usual speed.
        purpose: (B, T) of the rows: a run ends where it changes.
    """
    n_log, n_row = sequences.is_row.shape
    index = np.broadcast_to(np.arange(n_row, dtype=float), (n_log, n_row))
    session = np.broadcast_to(np.arange(n_log, dtype=float)[:, None], (n_log, n_row))
    place, session = averaged(index, rows.is_used), averaged(session, rows.is_used).astype(int)
    begins = (np.diff(place) != ROWS_AVERAGED) | (np.diff(session) != 0)
    if purpose is not None:
        begins |= np.diff(averaged(purpose.astype(float), rows.is_used)) != 0
    run = np.concatenate([[0], np.cumsum(begins)])
    since = _since_change(averaged(sequences.command, rows.is_used), run)
    moving = np.abs(velocity) > MOVING_SHARE * speed_scale
    state = np.where(since < SETTLED_ROWS, CHANGING, np.where(moving, MOVING, AT_REST))
    # Stamps as integers: as floating-point numbers they would be off by hundreds of nanoseconds.
    first = int(sequences.stamp_ns.min())
    stamp_ns = first + averaged((sequences.stamp_ns - first).astype(float), rows.is_used).astype(np.int64)
    return RowFacts(session, run, stamp_ns, state)


def _since_change(command: np.ndarray, run: np.ndarray) -> np.ndarray:
    """(N, n_joint) rows since a joint's command changed; many at the start of a run."""
    n = len(command)
    changed = np.zeros(command.shape, bool)
    changed[1:] = np.abs(np.diff(command, axis=0)) > SMALLEST_CHANGE
    begins = np.concatenate([[True], np.diff(run) != 0])
    changed[begins] = False
    row = np.arange(n)[:, None]
    latest = np.maximum.accumulate(np.where(changed, row, -1), axis=0)
    start = np.maximum.accumulate(np.where(begins, np.arange(n), 0))[:, None]
    return np.where(latest >= start, row - latest, n)
