"""Ridge regression of each joint's speed on the window of commands, with the products that hydraulics suggests.

What an engineer would try before a network. Speed to the next row is linear in: each direction's command over the last
`LAGS` rows; that command times each position (linkage, gravity); times each other joint's command in each direction
(shared flow); and times how many other joints are commanded at once, beyond one. Nothing measured is fed back but the
position, so that errors do not grow by themselves. The penalty has the least error on the validation rows.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification

LAGS = 24
PENALTIES = np.logspace(-6.0, 0.0, 7)  # per row, on standardised features


@dataclass(frozen=True)
class RidgePredictor:
    """A fitted regression.

    Attributes:
        machine: Limits and rate.
        weights: By joint, (n_features,), rad/s or m/s.
        intercept: (n_joint,).
    """

    machine: MachineSpecification
    weights: list[np.ndarray]
    intercept: np.ndarray

    @property
    def rows_before(self) -> int:
        """See `Predictor`."""
        return LAGS - 1

    def predict(self, trajectory: Trajectory, starts: np.ndarray, horizon: int) -> np.ndarray:
        """See `Predictor`."""
        q = trajectory.q[starts]
        path = np.empty((len(starts), horizon, q.shape[1]))
        for step in range(horizon):
            window = trajectory.a[starts[:, None] + step + np.arange(1 - LAGS, 1)]
            place = _place(q, self.machine)
            speed = np.stack(
                [features(window, place, joint) @ self.weights[joint] for joint in range(q.shape[1])], axis=1
            )
            q = q + self.machine.dt_s * (speed + self.intercept)
            path[:, step] = q
        return path


def features(window: np.ndarray, place: np.ndarray, joint: int) -> np.ndarray:
    """Of one joint.

    Args:
        window: (N, LAGS, n_joint) commands, the newest last.
        place: (N, n_joint) positions, -1 to 1 between the limits.
        joint: Whose speed is sought.

    Returns:
        (N, n_features).
    """
    others = np.delete(window, joint, axis=2)
    parts = np.concatenate([np.maximum(others, 0.0), np.maximum(-others, 0.0)], axis=2)
    excess = np.maximum(np.abs(others).sum(axis=2, keepdims=True) - 1.0, 0.0)
    ones = np.ones_like(excess)
    at_place = np.broadcast_to(place[:, None], (*window.shape[:2], place.shape[1]))
    factors = np.concatenate([ones, at_place, parts, excess], axis=2)
    own = window[:, :, joint]
    directions = np.stack([np.maximum(own, 0.0), np.maximum(-own, 0.0)], axis=2)
    products = directions[:, :, :, None] * factors[:, :, None, :]
    return products.reshape(len(window), -1)


def fit_ridge(learning: Sequence[Trajectory], machine: MachineSpecification, seed: int) -> RidgePredictor:
    """Fit to the training rows.

    Raises:
        InputError: There are no validation rows.
    """
    sets = [_rows(learning, machine, is_validation) for is_validation in (False, True)]
    if not all(len(part[0]) for part in sets):
        raise InputError(f"logs: no trajectory has {LAGS} training and validation rows; give longer logs")
    fitted = [_fit_joint(sets, joint) for joint in range(machine.n_joint)]
    return RidgePredictor(machine, [weights for weights, _ in fitted], np.array([b for _, b in fitted]))


def _fit_joint(sets: list[tuple[np.ndarray, np.ndarray, np.ndarray]], joint: int) -> tuple[np.ndarray, float]:
    (x, y), (x_judged, y_judged) = (
        (features(window, place, joint), speed[:, joint]) for window, place, speed in sets
    )
    mean, mean_speed, scale = x.mean(axis=0), float(y.mean()), x.std(axis=0)
    scale[scale == 0.0] = 1.0
    standard = (x - mean) / scale
    values, vectors = np.linalg.eigh(standard.T @ standard / len(x))
    projected = vectors.T @ (standard.T @ (y - mean_speed) / len(x))
    best, least = np.zeros(x.shape[1]), np.inf
    for penalty in PENALTIES:
        weights = vectors @ (projected / (np.maximum(values, 0.0) + penalty)) / scale
        error = float(np.mean(((x_judged - mean) @ weights + mean_speed - y_judged) ** 2))
        if error < least:
            best, least = weights, error
    return best, mean_speed - float(mean @ best)


def _rows(
    trajectories: Sequence[Trajectory], machine: MachineSpecification, is_validation: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Windows, places and speeds to the next row, of one split."""
    windows, places, speeds = [], [], []
    for trajectory in trajectories:
        rows = np.arange(LAGS - 1, len(trajectory) - 1)
        rows = rows[
            (trajectory.is_validation[rows] == is_validation)
            & (trajectory.is_validation[rows + 1] == is_validation)
        ]
        windows.append(trajectory.a[rows[:, None] + np.arange(1 - LAGS, 1)])
        places.append(_place(trajectory.q[rows], machine))
        speeds.append((trajectory.q[rows + 1] - trajectory.q[rows]) / machine.dt_s)
    return np.concatenate(windows), np.concatenate(places), np.concatenate(speeds)


def _place(q: np.ndarray, machine: MachineSpecification) -> np.ndarray:
    return 2.0 * (q - machine.lower) / (machine.upper - machine.lower) - 1.0
