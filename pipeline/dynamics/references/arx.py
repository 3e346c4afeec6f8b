"""A linear ARX model with the network's lags: the simplest reference.

Same inputs x̃ (paper, Eqs. x_t_pos and x_t_vel), same integration, but linear: residual = Wᵀ x̃ + b, fitted
by ridge-regularised least squares on one-step residuals in float64 (Ljung, "System Identification", section
4.2). Normalisation of the inputs only changes the meaning of the ridge, so x̃ is standardised by its
own rows.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.dynamics.model.dynamics_model import Target
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory


@dataclass(frozen=True)
class ArxPredictor:
    """A fitted ARX model.

    Attributes:
        target: dq or dqdot.
        lags: k.
        dt_s: Time step.
        weights: (2n(k+1) + n, n_joint), on x̃ in physical units.
        intercept: (n_joint,).
        limits: Lower and upper, (n_joint,), at which positions stop as in `LearnedPredictor`; None: no stops.
    """

    target: Target
    lags: int
    dt_s: float
    weights: np.ndarray
    intercept: np.ndarray
    limits: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def rows_before(self) -> int:
        """Lags: commands up to the one about to act."""
        return self.lags

    def predict(self, trajectory: Trajectory, starts: np.ndarray, horizon: int) -> np.ndarray:
        """See `errors.Predictor.predict`."""
        rows = starts[:, None] + np.arange(-self.lags, 1)
        future = starts[:, None] + np.arange(-self.lags, horizon)
        motion, commands = _motion(trajectory, self.target)[rows], trajectory.a[future]
        q = trajectory.q[starts]
        lower, upper = (-np.inf, np.inf) if self.limits is None else self.limits
        lower = np.minimum(lower, np.fmin.accumulate(trajectory.q)[starts])
        upper = np.maximum(upper, np.fmax.accumulate(trajectory.q)[starts])
        predictions = np.empty((len(starts), horizon, q.shape[-1]))
        for step in range(horizon):
            x = _regressors(motion, commands[:, step : step + self.lags + 1], q)
            residual = x @ self.weights + self.intercept
            if self.target is Target.dq:
                q = newest = np.clip(q + residual, lower, upper)
            else:
                newest = motion[:, -1] + residual
                q = np.clip(q + self.dt_s * newest, lower, upper)
            motion = np.concatenate([motion[:, 1:], newest[:, None]], axis=1)
            predictions[:, step] = q
        return predictions


def fit_arx(
    trajectories: Sequence[Trajectory], target: Target, lags: int, dt_s: float, ridge: float
) -> ArxPredictor:
    """Fit an ARX model to the training rows.

    Args:
        trajectories: Rows with their split; only training rows are used.
        target: dq: the residual is q_{t+1} − q_t. dqdot: it is q̇_{t+1} − q̇_t, the step to the next estimate.
            (Fitting (q_{t+1} − q_t)/Δt − q̇_t instead predicts one step better, but then unfiltered velocities
            are fed back, and the rollout is unstable.)
        lags: k.
        dt_s: Time step.
        ridge: Penalty on the squared weights of the standardised inputs, per row; not on the intercept.

    Raises:
        InputError: if no trajectory has lags + 2 consecutive training rows.
    """
    inputs, outputs = [], []
    for trajectory in trajectories:
        training = ~trajectory.is_validation
        ends = np.arange(lags, len(trajectory) - 1)
        ends = ends[training[ends] & training[ends + 1]]
        rows = ends[:, None] + np.arange(-lags, 1)
        motion = _motion(trajectory, target)
        inputs.append(_regressors(motion[rows], trajectory.a[rows], trajectory.q[ends]))
        outputs.append(motion[ends + 1] - motion[ends])
    x, y = np.concatenate(inputs), np.concatenate(outputs)
    if len(x) == 0:
        raise InputError(f"identify: no trajectory has {lags + 2} training rows in a row; give longer logs")
    mean, spread = x.mean(axis=0), x.std(axis=0)
    spread[spread == 0] = 1.0  # a constant input gets weight zero
    penalty = np.sqrt(ridge * len(x)) * np.eye(x.shape[1])
    z = np.concatenate([(x - mean) / spread, penalty])
    centred = np.concatenate([y - y.mean(axis=0), np.zeros((x.shape[1], y.shape[1]))])
    weights = np.linalg.lstsq(z, centred)[0] / spread[:, None]
    return ArxPredictor(target, lags, dt_s, weights, intercept=y.mean(axis=0) - mean @ weights)


def _motion(trajectory: Trajectory, target: Target) -> np.ndarray:
    return trajectory.q if target is Target.dq else trajectory.qd


def _regressors(motion: np.ndarray, commands: np.ndarray, q: np.ndarray) -> np.ndarray:
    n_inputs = motion.shape[1] * motion.shape[2]
    return np.concatenate([motion.reshape(-1, n_inputs), commands.reshape(-1, n_inputs), q], axis=1)
