"""What rows of logs show of a machine: how fast its joints usually move, and where they end."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pipeline.logs.tuples import Trajectory

SMALLEST_STANDS = 10  # rows from which a stop is known more exactly than its stated limit
NEAR_SHARE = 0.02  # of the range, from the stop
STANDING_SHARE = 0.15  # of the usual speed
BEYOND_SHARE = 0.01  # of the range: a joint that is seen further out than a stop by more has no stop there


class Shown(NamedTuple):
    """Rows, in any order; (N, n_joint) each.

    Attributes:
        command: a_t, in [-1, 1].
        q: rad or m.
        velocity: Displacement from row t to t+1 per time step, rad/s or m/s.
    """

    command: np.ndarray
    q: np.ndarray
    velocity: np.ndarray

    @classmethod
    def of(cls, trajectories: Sequence[Trajectory], dt_s: float) -> "Shown":
        """The training rows whose next row is one, too."""
        parts = []
        for trajectory in trajectories:
            kept = ~(trajectory.is_validation[:-1] | trajectory.is_validation[1:])
            velocity = np.diff(trajectory.q, axis=0) / dt_s
            parts.append((trajectory.a[:-1][kept], trajectory.q[:-1][kept], velocity[kept]))
        return cls(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def usual_speed(self) -> np.ndarray:
        """(n_joint,) root mean square of the velocity while commanded; 1 of a joint that never moves."""
        moving = np.abs(self.command) > 0.0
        mean_square = np.sum(np.where(moving, self.velocity**2, 0.0), axis=0) / np.maximum(
            moving.sum(axis=0), 1
        )
        return np.where(mean_square > 0.0, np.sqrt(mean_square), 1.0)

    def stops(self, lower: np.ndarray, upper: np.ndarray, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where joints stand against their stops.

        Args:
            lower: (n_joint,) stated limits.
            upper: (n_joint,) stated limits.
            speed: (n_joint,) usual ones.

        Returns:
            Lower and upper stops, (n_joint,): where a joint stands against it, or the stated limit where none is seen
            to; infinite where the joint goes beyond. A joint that goes on from where it stood was late, not stopped.
        """
        beyond = BEYOND_SHARE * (upper - lower)
        stop_lower = np.where(self.q.min(axis=0) > lower - beyond, lower, -np.inf)
        stop_upper = np.where(self.q.max(axis=0) < upper + beyond, upper, np.inf)
        below, above = standing(
            self.q, self.velocity, self.command, stop_lower, stop_upper, upper - lower, speed
        )
        for joint in range(len(speed)):
            for stop, stands, sign in ((stop_lower, below, -1.0), (stop_upper, above, 1.0)):
                if stands[:, joint].sum() >= SMALLEST_STANDS:
                    place = np.median(self.q[stands[:, joint], joint])
                    if np.max(sign * (self.q[:, joint] - place)) <= beyond[joint]:
                        stop[joint] = place
        return stop_lower, stop_upper


def standing(
    q: np.ndarray,
    velocity: np.ndarray,
    command: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    span: np.ndarray,
    speed: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Where a joint is pushed against its lower, and its upper stop, each (..., n_joint) bool.

    Args:
        q: (..., n_joint), as are velocity and command.
        velocity: rad/s or m/s.
        command: in [-1, 1].
        lower: (n_joint,) stops; infinite where there are none.
        upper: The same above.
        span: (n_joint,) between the joint limits.
        speed: (n_joint,) usual ones.
    """
    slow = np.abs(velocity) < STANDING_SHARE * speed
    below = slow & (q < lower + NEAR_SHARE * span) & (command < 0.0)
    above = slow & (q > upper - NEAR_SHARE * span) & (command > 0.0)
    return below, above
