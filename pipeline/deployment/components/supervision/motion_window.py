"""Whether half of a joint's speed explains its last motion better than the whole.

A step counts in which a joint moves, or its model expects it to. Of a window of such steps, m are the measured
displacements, e_s those expected s steps before, and v is the share of speed to be told. Evidence is

    D = [min_s Σ (m - e_s)² - min(min_s Σ (m - v e_s)², min_s Σ (v m - e_s)²)] / Σ max(|m|, |e_0|)²

Each sum has its own best shift s: what a start draws anew, or a spool swallows after a rest, is no evidence. The third
sum tells a joint that is too fast, or moves without command.
"""

import numpy as np

from pipeline.dynamics.model.shown_motion import NEAR_SHARE, STANDING_SHARE
from pipeline.dynamics.model.specification import ModelSpecification

EARLIEST_S, LATEST_S = (
    0.15,
    0.45,
)  # dead times of one machine differ by 0.15 s; a spool that rested adds 0.3 s


class MotionSteps:
    """Steps of a model's joints.

    Attributes:
        lead: steps by which a joint may be early; so much later a step is judged.
        n_shift: number of shifts.
    """

    def __init__(self, specification: ModelSpecification, speed: float) -> None:
        """Steps of joints that are to be told at this share of their speed."""
        lower, upper = np.array(specification.position_lower), np.array(specification.position_upper)
        margin = NEAR_SHARE * (upper - lower)
        self._lower, self._upper = lower + margin, upper - margin
        self._standing = STANDING_SHARE * specification.dt_s * np.array(specification.velocity_limit)
        self._speed = speed
        self.lead, self._delay = (round(shift / specification.dt_s) for shift in (EARLIEST_S, LATEST_S))
        self.n_shift = self._delay + 1 + self.lead

    def around(self, expected: np.ndarray) -> np.ndarray:
        """What was expected around each step but the last `lead`: of (T, n_joint), (T - lead, n_joint, n_shift)."""
        padded = np.pad(expected, ((self._delay, self.lead + 1), (0, 0)))
        windows = np.lib.stride_tricks.sliding_window_view(padded, self.n_shift, axis=0)
        return windows[: max(0, len(expected) - self.lead)]

    def count(self, q: np.ndarray, around: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """Whether steps from `q` count, (..., n_joint): also not if the joint is pushed into an end of its range."""
        expected = around[..., self._delay]
        is_pushed = ((q < self._lower) & (expected < 0)) | ((q > self._upper) & (expected > 0))
        return (np.maximum(np.abs(expected), np.abs(measured)) > self._standing) & ~is_pushed

    def terms(self, around: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """Summands of the evidence: of (..., n_shift) and (...), rad (m); (..., 4, n_shift), their squares."""
        m, expected = np.broadcast_to(measured[..., None], around.shape), around[..., [self._delay]]
        motion = np.maximum(np.abs(m), np.abs(expected))
        return (
            np.stack([m - around, m - self._speed * around, self._speed * m - around, motion], axis=-2) ** 2
        )


def evidence(sums: np.ndarray) -> np.ndarray:
    """D of summed terms, (..., 4, n_shift); (...)."""
    followed, slow, fast, motion = np.moveaxis(sums.min(axis=-1), -1, 0)
    return np.asarray((followed - np.minimum(slow, fast)) / motion)
