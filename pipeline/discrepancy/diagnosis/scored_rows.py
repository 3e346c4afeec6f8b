"""The rows of the logs that candidates are scored on: which, averaged how, in which blocks and folds."""

from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.selection.regression import Folds

ROWS_AVERAGED = 2  # velocities over one step carry the encoders' noise twice


@dataclass(frozen=True)
class ScoredRows:
    """Rows on which candidates are scored.

    Attributes:
        is_used: (B, T) bool.
        folds: Of the used rows after averaging.
        floor: (n_joint,) mean square of the noise floor after averaging.
        weight: (N, n_joint) 0 where a joint stands against a stop, 1 elsewhere.
    """

    is_used: np.ndarray
    folds: Folds
    floor: np.ndarray
    weight: np.ndarray

    def averaged(self, values: np.ndarray) -> np.ndarray:
        """(B, T, ...) to the used rows, means over `ROWS_AVERAGED` rows: (N, ...)."""
        return averaged(values, self.is_used)


def rows_in_blocks(
    is_used: np.ndarray, fold: np.ndarray, is_known: np.ndarray, floor: np.ndarray, block_rows: int
) -> ScoredRows:
    """Rows to score candidates on, in blocks of the bootstrap.

    Args:
        is_used: (B, T) bool.
        fold: (B, T) 0 or 1.
        is_known: (B, T, n_joint) bool: where the nominal logs show how the joint moves.
        floor: (n_joint,) see `ScoredRows`.
        block_rows: Rows of a block; none crosses from one log into the next.
    """
    numbers = averaged(_blocks(is_used, block_rows).astype(float), is_used).astype(int)
    unique, index = np.unique(numbers, return_inverse=True)
    folds = Folds((averaged(fold.astype(float), is_used) > 0.5).astype(int), index, max(len(unique), 1))
    return ScoredRows(
        is_used, folds, floor, (averaged(is_known.astype(float), is_used) > 0.999).astype(float)
    )


def alternating_folds(is_used: np.ndarray, block_rows: int, fold_rows: int) -> np.ndarray:
    """Folds that alternate over the used rows of all logs in their order, (B, T) 0 or 1.

    Not within each log: of logs shorter than a stretch no row would be held out.

    Args:
        is_used: (B, T) bool.
        block_rows: As of `rows_in_blocks`; no block falls into both folds.
        fold_rows: Of a stretch of one fold, if there are blocks for two of them.
    """
    blocks, number = np.unique(_blocks(is_used, block_rows)[is_used], return_inverse=True)
    fold = np.zeros(is_used.shape, int)
    fold[is_used] = number // max(1, min(fold_rows // block_rows, len(blocks) // 2)) % 2
    return fold


def _blocks(is_used: np.ndarray, block_rows: int) -> np.ndarray:
    """Numbers of the rows' blocks, (B, T), rising from log to log."""
    n_logs, n_rows = is_used.shape
    return np.arange(n_rows) // block_rows + (np.arange(n_logs) * n_rows)[:, None]


def averaged(values: np.ndarray, is_used: np.ndarray) -> np.ndarray:
    """Means over groups of `ROWS_AVERAGED` rows that are all used: (B, T, ...) to (N, ...)."""
    return _grouped(values).mean(axis=2)[_grouped(is_used).all(axis=2)]


def spread(values: np.ndarray, is_used: np.ndarray) -> np.ndarray:
    """What `averaged` gave, back on the rows that it is of, 0 on all others: (N, ...) to (B, T, ...)."""
    whole = _grouped(is_used).all(axis=2)
    grouped = np.zeros((*whole.shape, *values.shape[1:]))
    grouped[whole] = values
    result = np.zeros((*is_used.shape, *values.shape[1:]))
    result[:, : whole.shape[1] * ROWS_AVERAGED] = np.repeat(grouped, ROWS_AVERAGED, axis=1)
    return result


def _grouped(values: np.ndarray) -> np.ndarray:
    """(B, T, ...) to (B, n_groups, ROWS_AVERAGED, ...)."""
    n_groups = values.shape[1] // ROWS_AVERAGED
    whole = values[:, : n_groups * ROWS_AVERAGED]
    return whole.reshape(len(values), n_groups, ROWS_AVERAGED, *values.shape[2:])
