"""Velocities of a machine that measures positions only: the paper's loop tracker, online.

The tracker runs on rows at the machine's rate, interpolated between readings, as for model identification
(contract, section 2); a row is complete with the first reading at or after it.
"""

import numpy as np

from pipeline.logs.loop_tracker import LoopTrackerConfig, LoopTrackerState, advance, initial_state


class VelocityEstimator:
    """Estimates the velocity of the newest complete row from readings."""

    def __init__(self, period_ns: int, config: LoopTrackerConfig) -> None:
        """An estimator of rows `period_ns` apart; the first reading is its first row."""
        self._period_ns = period_ns
        self._config = config
        self._state: LoopTrackerState | None = None
        self._last_ns = 0
        self._last = np.empty(0)
        self._next_row_ns = 0

    def update(self, stamp_ns: int, position: np.ndarray) -> np.ndarray:
        """Process a reading; return the velocity estimate, (n_joint,), rad/s (m/s).

        A reading that is not newer than the previous one is ignored.
        """
        if self._state is None:
            self._state = initial_state(position)
            self._next_row_ns = stamp_ns + self._period_ns
        elif stamp_ns > self._last_ns:
            while self._next_row_ns <= stamp_ns:
                share = (self._next_row_ns - self._last_ns) / (stamp_ns - self._last_ns)
                row = self._last + share * (position - self._last)
                self._state, _ = advance(self._state, row, self._period_ns * 1e-9, self._config)
                self._next_row_ns += self._period_ns
        else:
            return self._state.integral
        self._last_ns, self._last = stamp_ns, np.asarray(position, np.float64)
        return self._state.integral
