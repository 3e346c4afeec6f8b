"""Growth of open-loop errors over the horizon, with bootstrap bands.

Windows of the same horizon start every few rows of each trajectory, so neighbours overlap and are not
independent. The bands therefore come from a moving-block bootstrap (Künsch, "The jackknife and the bootstrap
for general stationary observations", Annals of Statistics 17(3), 1989): blocks of successive windows, as many
as one horizon spans, are drawn with replacement, never across trajectories.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.dynamics.evaluation.errors import Predictor, open_loop_residuals
from pipeline.dynamics.training.windows import FIRST_JUDGED_ROW
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory

MAXIMUM_WINDOWS = 2000  # longer logs use a wider stride, which bounds memory
MINIMUM_BLOCKS = 4  # fewer independent blocks do not support a bootstrap


@dataclass
class ErrorGrowthConfig:
    """Settings of the error-growth measurement.

    Attributes:
        horizon: Longest horizon, steps.
        stride: Rows between window starts.
        resamples: Bootstrap samples.
        confidence: Share of the bootstrap samples inside the band.
        seed: Seed of the bootstrap.
    """

    horizon: int
    stride: int
    resamples: int
    confidence: float
    seed: int

    def __post_init__(self) -> None:
        for name in ("horizon", "stride", "resamples"):
            if getattr(self, name) < 1:
                raise InputError(f"judge.growth.{name} is {getattr(self, name)}; it must be at least 1")
        if not 0 < self.confidence < 1:
            raise InputError(f"judge.growth.confidence is {self.confidence}; it must be between 0 and 1")
        if self.seed < 0:
            raise InputError(f"judge.growth.seed is {self.seed}; it must not be negative")


@dataclass(frozen=True)
class ErrorGrowth:
    """Error over horizons of 1 … H steps.

    Attributes:
        rmse: (H, n_joint) rad or m: root mean square over windows of the error h steps after the start.
        lower: (H, n_joint) lower end of the band; NaN if the log is too short for one.
        upper: (H, n_joint) upper end likewise.
        n_windows: Number of windows, which overlap.
        n_blocks: Number of disjoint stretches of H steps in the log, the band's sample size.
    """

    rmse: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    n_windows: int
    n_blocks: int


def error_growth(
    predictor: Predictor, trajectories: Sequence[Trajectory], config: ErrorGrowthConfig
) -> ErrorGrowth:
    """Measure the error at every horizon up to the longest, over all windows.

    Equal configuration and trajectories give equal windows and bootstrap samples for every predictor. If no
    trajectory is long enough for the horizon, the longest possible horizon is used.

    Raises:
        InputError: if no trajectory is longer than the history that every predictor may use.
    """
    horizon = min(config.horizon, max(len(trajectory) for trajectory in trajectories) - FIRST_JUDGED_ROW - 1)
    if horizon < 1:
        raise InputError(
            f"logs: no trajectory is longer than {FIRST_JUDGED_ROW + 1} rows, after which errors are measured; "
            "give longer logs"
        )
    stride = _stride(trajectories, horizon, config.stride)
    block = -(-horizon // stride)
    total = np.zeros((horizon, trajectories[0].q.shape[1]))
    n_windows, n_blocks = 0, 0
    sums, lengths = [], []
    for trajectory in trajectories:
        starts = _starts(trajectory, horizon, stride)
        if len(starts) == 0:
            continue
        squares = open_loop_residuals(predictor, trajectory, starts, horizon) ** 2
        total += squares.sum(axis=0)
        n_windows += len(starts)
        n_blocks += (len(trajectory) - FIRST_JUDGED_ROW - 1) // horizon
        length = min(block, len(starts))
        firsts = len(starts) - length + 1
        sums.append(sum(squares[offset : offset + firsts] for offset in range(length)))
        lengths.append(np.full(firsts, length))
    rmse = np.sqrt(total / n_windows)
    lower = upper = np.full_like(rmse, np.nan)
    if n_blocks >= MINIMUM_BLOCKS:
        lower, upper = _band(np.concatenate(sums), np.concatenate(lengths), total, n_windows, config)
    return ErrorGrowth(rmse, lower, upper, n_windows=n_windows, n_blocks=n_blocks)


def _band(
    sums: np.ndarray, lengths: np.ndarray, total: np.ndarray, n_windows: int, config: ErrorGrowthConfig
) -> tuple[np.ndarray, np.ndarray]:
    """Percentiles of the RMSE over resampled blocks.

    Args:
        sums: (n_firsts, H, n_joint), squared errors summed over each block.
        lengths: (n_firsts,) number of windows per block.
        total: (H, n_joint), squared errors summed over all windows.
        n_windows: Total number of windows.
        config: Samples and confidence.

    Returns:
        Two arrays (H, n_joint).
    """
    random = np.random.default_rng(config.seed)
    drawn = -(-n_windows // int(lengths.max()))  # blocks per sample, for the original number of windows
    counts = random.multinomial(drawn, np.full(len(sums), 1.0 / len(sums)), size=config.resamples)
    mean_squares = (counts @ sums.reshape(len(sums), -1)) / (counts @ lengths)[:, None]
    # Windows at a trajectory's ends lie in fewer blocks than others, so the samples are centred on the measured error
    # (Lahiri, "Resampling Methods for Dependent Data", Springer 2003, section 2.7).
    expected = sums.sum(axis=0).ravel() / lengths.sum()
    mean_squares *= (total / n_windows).ravel() / np.where(expected > 0, expected, 1.0)
    tail = 50.0 * (1.0 - config.confidence)
    lower, upper = np.sqrt(np.percentile(mean_squares, [tail, 100.0 - tail], axis=0))
    return lower.reshape(sums.shape[1:]), upper.reshape(sums.shape[1:])


def _starts(trajectory: Trajectory, horizon: int, stride: int) -> np.ndarray:
    return np.arange(FIRST_JUDGED_ROW, len(trajectory) - horizon, stride)


def _stride(trajectories: Sequence[Trajectory], horizon: int, stride: int) -> int:
    """The stride, multiplied by an integer if there are too many windows."""
    n_windows = sum(len(_starts(trajectory, horizon, stride)) for trajectory in trajectories)
    return stride * max(1, -(-n_windows // MAXIMUM_WINDOWS))
