"""A grey-box model, joint by joint: dead time, first-order lag and a gain per direction; a reference.

    τ v̇(s) = −v(s) + g(a(s − θ)),   q̇(s) = v(s),   g(a) = K₊ a for a > 0, K₋ a for a < 0, 0 at rest

the usual first model of a hydraulic axis (valve dead time, spool and pressure build-up as one lag, speeds that differ
with the piston's areas). Commands are held over a time step, so the discretisation is exact for any dead time. A
simulation starts from the measured position and the velocity estimate of the start row.

The fit minimises the error of simulations over many steps (Ljung, "System Identification", section 10.5 on
output-error models). Positions are linear in the gains, which follow by least squares for given θ and τ. A grid
search over θ and τ is refined around its best point.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.dynamics.training.windows import window_starts
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory

REFINED_POINTS = 9  # per axis of a refined grid, which spans two steps of the previous one


@dataclass
class GreyBoxConfig:
    """Settings of the grey-box fit.

    Attributes:
        horizon: Steps simulated from each start row.
        maximum_dead_time_s: The grid of θ starts at zero and ends here.
        minimum_lag_s: Smallest τ of the grid, which is geometric.
        maximum_lag_s: Largest τ.
        grid_points: Points of the first grid along each axis.
        refinements: How often the grid is refined.
    """

    horizon: int
    maximum_dead_time_s: float
    minimum_lag_s: float
    maximum_lag_s: float
    grid_points: int
    refinements: int

    def __post_init__(self) -> None:
        if self.horizon < 1:
            raise InputError(f"judge.grey_box.horizon is {self.horizon}; it must be at least 1")
        if self.grid_points < 3:
            raise InputError(f"judge.grey_box.grid_points is {self.grid_points}; it must be at least 3")
        if self.refinements < 0:
            raise InputError(f"judge.grey_box.refinements is {self.refinements}; it must not be negative")
        if not self.maximum_dead_time_s >= 0:
            raise InputError(
                f"judge.grey_box.maximum_dead_time_s is {self.maximum_dead_time_s}; it must not be negative"
            )
        if not 0 < self.minimum_lag_s < self.maximum_lag_s:
            raise InputError(
                f"judge.grey_box: minimum_lag_s {self.minimum_lag_s} and maximum_lag_s {self.maximum_lag_s} must "
                "satisfy 0 < minimum_lag_s < maximum_lag_s"
            )


@dataclass(frozen=True)
class GreyBoxPredictor:
    """A fitted grey-box model.

    Attributes:
        dt_s: Time step.
        dead_time_s: (n_joint,) θ.
        lag_s: (n_joint,) τ.
        gain_positive: (n_joint,) K₊, speed at command 1, rad/s or m/s.
        gain_negative: (n_joint,) K₋, minus the velocity at command -1, rad/s or m/s.
    """

    dt_s: float
    dead_time_s: np.ndarray
    lag_s: np.ndarray
    gain_positive: np.ndarray
    gain_negative: np.ndarray

    @property
    def rows_before(self) -> int:
        """The longest dead time in steps, rounded up."""
        return _rows_of(float(self.dead_time_s.max()), self.dt_s)

    def predict(self, trajectory: Trajectory, starts: np.ndarray, horizon: int) -> np.ndarray:
        """See `errors.Predictor.predict`."""
        before = self.rows_before
        commands = trajectory.a[starts[:, None] + np.arange(-before, horizon)]
        predictions = np.repeat(np.asarray(trajectory.q[starts], np.float64)[:, None], horizon, axis=1)
        for joint in range(predictions.shape[-1]):
            free, positive, negative = _responses(
                commands[..., joint],
                trajectory.qd[starts, joint],
                before,
                float(self.dead_time_s[joint]),
                float(self.lag_s[joint]),
                self.dt_s,
            )
            predictions[..., joint] += (
                free + self.gain_positive[joint] * positive + self.gain_negative[joint] * negative
            )
        return predictions


def fit_grey_box(trajectories: Sequence[Trajectory], config: GreyBoxConfig, dt_s: float) -> GreyBoxPredictor:
    """Fit every joint's four parameters on the training rows.

    The gain is zero in a direction without commands.

    Args:
        trajectories: Rows with their split; only disjoint windows of training rows are used.
        config: Horizon and grid.
        dt_s: Length of one time step.

    Raises:
        InputError: if no trajectory has a window of training rows.
    """
    before = _rows_of(config.maximum_dead_time_s, dt_s)
    parts = []
    for trajectory in trajectories:
        starts = window_starts([trajectory], validation=False, first_row=before, horizon=config.horizon)
        starts = starts[:: config.horizon]
        rows = starts[:, None] + np.arange(-before, config.horizon + 1)
        parts.append((trajectory.q[rows[:, before:]], trajectory.qd[starts], trajectory.a[rows[:, :-1]]))
    q, velocity, commands = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    if len(q) == 0:
        raise InputError(
            f"judge: no trajectory has {before + config.horizon + 1} training rows in a row, which the grey-box "
            "model's simulations need; give longer logs or lower judge.grey_box.horizon"
        )
    fitted = [
        _fit_joint(
            q[:, 1:, joint] - q[:, :1, joint], velocity[:, joint], commands[..., joint], before, config, dt_s
        )
        for joint in range(q.shape[-1])
    ]
    return GreyBoxPredictor(dt_s, *np.array(fitted).T)


def _fit_joint(
    displacement: np.ndarray,
    velocity: np.ndarray,
    commands: np.ndarray,
    before: int,
    config: GreyBoxConfig,
    dt_s: float,
) -> tuple[float, float, float, float]:
    """θ, τ, K₊ and K₋ with the smallest squared error of the displacements (W, H)."""
    dead_times = np.linspace(0.0, config.maximum_dead_time_s, config.grid_points)
    log_lags = np.linspace(np.log(config.minimum_lag_s), np.log(config.maximum_lag_s), config.grid_points)
    best: tuple[float, ...] = (np.inf,)
    for _ in range(1 + config.refinements):
        for dead_time in dead_times.tolist():
            for log_lag in log_lags.tolist():
                loss, gains = _gains(
                    displacement, *_responses(commands, velocity, before, dead_time, np.exp(log_lag), dt_s)
                )
                if loss < best[0]:
                    best = (loss, dead_time, log_lag, *gains)
        dead_times = _refined(dead_times, best[1], 0.0, config.maximum_dead_time_s)
        log_lags = _refined(log_lags, best[2], np.log(config.minimum_lag_s), np.log(config.maximum_lag_s))
    _, dead_time, log_lag, gain_positive, gain_negative = best
    return dead_time, float(np.exp(log_lag)), gain_positive, gain_negative


def _refined(grid: np.ndarray, best: float, lower: float, upper: float) -> np.ndarray:
    """A grid around the best point that reaches to its neighbours, so that the optimum stays inside."""
    step = grid[1] - grid[0]
    return np.linspace(max(lower, best - step), min(upper, best + step), REFINED_POINTS)


def _gains(
    displacement: np.ndarray, free: np.ndarray, positive: np.ndarray, negative: np.ndarray
) -> tuple[float, tuple[float, float]]:
    """The gains by least squares, and the remaining squared error."""
    forced = (displacement - free).ravel()
    responses = np.stack([positive.ravel(), negative.ravel()])
    # The least-norm solution is zero for a direction without commands.
    gains = np.linalg.pinv(responses @ responses.T, hermitian=True) @ (responses @ forced)
    return float(np.sum((forced - gains @ responses) ** 2)), (float(gains[0]), float(gains[1]))


def _responses(
    commands: np.ndarray, velocity: np.ndarray, before: int, dead_time_s: float, lag_s: float, dt_s: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacements after each step due to the initial velocity, and to positive and negative commands at gain one.

    Args:
        commands: (W, before + H), commands of one joint.
        velocity: (W,) initial velocities.
        before: Rows of commands before the start row.
        dead_time_s: θ.
        lag_s: τ.
        dt_s: Length of one time step.

    Returns:
        Three arrays (W, H).
    """
    # Imported here, as other modules need only the settings and the import takes two seconds.
    from scipy.signal import lfilter

    whole = int(dead_time_s / dt_s)
    late_s = dead_time_s - whole * dt_s  # time within a step during which the older command acts
    early_s = dt_s - late_s
    late, early = np.exp(-late_s / lag_s), np.exp(-early_s / lag_s)
    decay = late * early
    horizon = commands.shape[1] - before
    steps = np.arange(1, horizon + 1)
    free = velocity[:, None] * lag_s * (1.0 - decay**steps)

    def forced(drive: np.ndarray) -> np.ndarray:
        newer = drive[:, before - whole : before - whole + horizon]
        older = drive[:, before - whole - 1 : before - whole - 1 + horizon] if whole < before else newer
        speed_after = lfilter([1.0], [1.0, -decay], (early - decay) * older + (1.0 - early) * newer)
        speed_before = np.concatenate([np.zeros((len(drive), 1)), speed_after[:, :-1]], axis=1)
        increments = (
            lag_s * (1.0 - decay) * speed_before
            + (late_s - lag_s * (1.0 - late) * early) * older
            + (early_s - lag_s * (1.0 - early)) * newer
        )
        return np.cumsum(increments, axis=1)

    return free, forced(np.maximum(commands, 0.0)), forced(np.minimum(commands, 0.0))


def _rows_of(dead_time_s: float, dt_s: float) -> int:
    return int(np.ceil(dead_time_s / dt_s))
