"""Short windows of logged rows for training and evaluation, indexed on the device.

The rows of all trajectories lie one after another in one buffer. A window that starts at row s uses rows
s-k-1 … s as history (k lags) and rows s … s+H as the horizon: commands of rows s … s+H-1, configurations of
rows s+1 … s+H. It lies in one trajectory. It belongs to a split (`train` or `validation`) if all rows
s … s+H do; its history may reach back into earlier rows of any split, as for a predictor in use.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.features import History
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory

# First row of the contract's error windows (section 3), so that all models are judged on the same rows.
FIRST_JUDGED_ROW = 40


class TrainingRows(NamedTuple):
    """Rows of all trajectories, one trajectory after another.

    Attributes:
        q: (N, n_joint) positions.
        qd: (N, n_joint) velocity estimates.
        a: (N, n_joint) commands.
    """

    q: jax.Array
    qd: jax.Array
    a: jax.Array


class Window(NamedTuple):
    """A batch of windows.

    Attributes:
        history: At the start row, before its command acts.
        commands: (..., H, n_joint), rows s … s+H-1.
        q: (..., H, n_joint), rows s+1 … s+H.
    """

    history: History
    commands: jax.Array
    q: jax.Array


def stack_rows(trajectories: Sequence[Trajectory]) -> TrainingRows:
    """Put the trajectories' rows on the device as float32."""
    return TrainingRows(
        *(
            jnp.asarray(
                np.concatenate([getattr(trajectory, name) for trajectory in trajectories]), jnp.float32
            )
            for name in ("q", "qd", "a")
        )
    )


def window_starts(
    trajectories: Sequence[Trajectory], validation: bool, first_row: int, horizon: int
) -> np.ndarray:
    """Every start row whose window lies in one trajectory and in one split.

    Args:
        trajectories: In the order given to `stack_rows`.
        validation: Whether the split is the validation rows (True) or the training rows (False).
        first_row: Earliest start row within a trajectory; at least lags + 1.
        horizon: H.

    Returns:
        (n_windows,) int32, ascending, indices into the stacked rows.
    """
    starts, offset = [], 0
    for trajectory in trajectories:
        n_rows = len(trajectory.q)
        outside = np.concatenate([[0], np.cumsum(trajectory.is_validation != validation)])
        candidates = np.arange(first_row, max(first_row, n_rows - horizon))
        whole = outside[candidates + horizon + 1] == outside[candidates]
        starts.append(offset + candidates[whole])
        offset += n_rows
    return np.concatenate(starts).astype(np.int32)


def evaluation_starts(
    trajectories: Sequence[Trajectory], horizon: int, n_windows: int, seed: int
) -> np.ndarray:
    """The fixed evaluation windows of L|eval: drawn without replacement from the validation rows.

    They depend only on the rows, the horizon and the seed, not on a model's lags, so that models are comparable.

    Raises:
        InputError: if the validation rows hold fewer than `n_windows` windows.
    """
    starts = window_starts(trajectories, validation=True, first_row=FIRST_JUDGED_ROW, horizon=horizon)
    if len(starts) < n_windows:
        raise InputError(
            f"identify: the validation rows hold {len(starts)} windows of {horizon} steps, "
            f"identify.evaluation_windows asks for {n_windows}; record longer or lower it"
        )
    return np.sort(np.random.default_rng(seed).choice(starts, size=n_windows, replace=False))


def gather_windows(model: DynamicsModel, rows: TrainingRows, starts: jax.Array, horizon: int) -> Window:
    """Cut the windows that start at `starts` (B,) out of the rows; for use under jit."""
    n_history = model.specification.lags + 2

    def cut(array: jax.Array, first: jax.Array, length: int) -> jax.Array:
        return jax.vmap(lambda row: jax.lax.dynamic_slice_in_dim(array, row, length))(first)

    oldest = starts - (n_history - 1)
    return Window(
        history=model.history_from_rows(*(cut(array, oldest, n_history) for array in rows)),
        commands=cut(rows.a, starts, horizon),
        q=cut(rows.q, starts + 1, horizon),
    )
