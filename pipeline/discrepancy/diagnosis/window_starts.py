"""Where windows of rows of one purpose begin."""

import numpy as np

from pipeline.dynamics.evaluation.errors import one_step_starts, open_loop_starts
from pipeline.dynamics.training.windows import FIRST_JUDGED_ROW

STRIDE = 20


def starts_within(allowed: np.ndarray, horizon: int) -> np.ndarray:
    """Start rows of the contract's windows all of whose rows are allowed: (T,) bool to (n,)."""
    n_rows = len(allowed)
    if horizon == 1:
        starts = one_step_starts(n_rows)
    elif horizon == 80:
        starts = open_loop_starts(n_rows)
    else:
        starts = np.arange(FIRST_JUDGED_ROW, n_rows - horizon, STRIDE)
    outside = np.concatenate([[0], np.cumsum(~allowed)])
    return starts[outside[starts + horizon + 1] == outside[starts]]
