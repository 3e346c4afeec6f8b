"""`other` with `absolute_time`: one joint's speed varies over a session as nothing that was measured explains.

As for a common change of speed (`supply_variation.py`) there is nothing to regress on. What the joint's own residual is
some seconds before and after a row is tried whether it predicts it there; the seconds around the row are left out, in
which any effect of commands or poses would say the same.

Equation: v_j = u_j e^{z_j(t)}, z_j by a kernel's means over time, each without its own neighbourhood; source:
De Brabanter et al. (2011), Kernel Regression in the Presence of Correlated Errors, Journal of Machine Learning
Research 12.
"""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
from scipy.signal import fftconvolve

from pipeline.discrepancy.regression import evidence
from pipeline.discrepancy.screen import Candidate, Nominal, Rows, averaged, scored, spread
from pipeline.discrepancy.simulation import Hypothesis, Simulation

FAMILY = "other:absolute_time"
WIDTHS_S = (3.0, 6.0, 12.0, 24.0)
LEFT_OUT_S = 1.5  # to either side: longer than a motion's residual is alike
KERNEL_WIDTHS = 3.0  # to either side
PRIOR_STD = 0.1  # of z: keeps the estimate at zero where the joint does not move


class _Course:
    """A joint's change of speed as its own residual shows it at other times."""

    def __init__(
        self, simulation: Simulation, active: Hypothesis, rows: Rows, beside: Rows | None = None
    ) -> None:
        velocity = simulation.velocities([active])[0]
        residual = simulation.sequences.velocity - velocity
        known = sum(spread(of.weight, of.is_used) for of in (rows, beside) if of is not None)
        self.rows = rows
        self.dt_s = simulation.setting.dt_s
        self.velocity = np.where(rows.is_used[..., None], velocity, 0.0)
        self.product = known * residual * velocity / rows.floor
        self.square = known * velocity**2 / rows.floor
        self.reference = rows.weight * rows.averaged(np.where(rows.is_used[..., None], residual, 0.0))

    def of(self, joint: int, width_s: float) -> np.ndarray:
        """z, (B, T)."""
        half = round(KERNEL_WIDTHS * width_s / self.dt_s)
        distance_s = self.dt_s * np.abs(np.arange(-half, half + 1))
        kernel = np.exp(-0.5 * (distance_s / width_s) ** 2) * (distance_s > LEFT_OUT_S)
        product, square = (
            fftconvolve(of[..., joint], kernel[None], mode="full", axes=1)[:, half:-half]
            for of in (self.product, self.square)
        )
        # The floor's correlation leaves about one independent value per second.
        information = np.maximum(square, 0.0) * self.dt_s
        return product / np.maximum(square, 1e-9) * information / (information + 1.0 / PRIOR_STD**2)

    def regressor(self, joint: int, z: np.ndarray) -> np.ndarray:
        """(N,) change of the joint's velocity."""
        return self.rows.weight[:, joint] * averaged(z * self.velocity[..., joint], self.rows.is_used)


def course_candidates(
    simulation: Simulation,
    active: Hypothesis,
    rows: Rows,
    nominal: Nominal = MappingProxyType({}),
) -> list[Candidate]:
    """One candidate per joint, at the best width.

    Args:
        simulation: On the logs.
        active: Effects beside it.
        rows: Rows on which it is scored.
        nominal: What joints' speeds vary by on nominal logs, as much of which per row is owed to the model's misfit.
    """
    course = _Course(simulation, active, rows)
    n = len(rows.folds.fold)
    candidates = []
    for joint in range(simulation.setting.n_joint):
        options = [_candidate(course, joint, width_s) for width_s in WIDTHS_S]
        best = max(options, key=lambda candidate: candidate.gain)
        candidates.append(
            replace(best, owed=nominal[best.key].most_per_row * n) if best.key in nominal else best
        )
    return candidates


def _candidate(course: _Course, joint: int, width_s: float) -> Candidate:
    reference = course.reference[:, joint]
    regressor = course.regressor(joint, course.of(joint, width_s))[:, None]
    found = evidence(reference, reference, regressor, course.rows.folds, np.array([0.0]), np.array([2.0]))
    return scored(found, reference, course.rows.floor[joint], FAMILY, joint, None, {"width": width_s}, ())


def beyond_constants(
    simulation: Simulation, active: Hypothesis, rows: Rows, beside: Rows, joint: int, width_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """What the best constant ratio of either direction leaves, which is no course, and what the course leaves of it.

    Not a course that is shifted in time: one that comes round again explains as much a period later.

    Args:
        simulation: On the logs.
        active: Effects beside it.
        rows: Rows on which it is scored.
        beside: Further rows that tell of the course.
        joint: Index.
        width_s: Of the kernel.

    Returns:
        (N,) residuals without and with the course.
    """
    course = _Course(simulation, active, rows, beside)
    residual = course.reference[:, joint]
    moving = course.velocity[..., joint]
    ways = np.stack([course.regressor(joint, way) for way in (moving > 0.0, moving < 0.0)], axis=1)
    both = np.column_stack([ways, course.regressor(joint, course.of(joint, width_s))])
    most = np.full(3, 2.0)
    least = np.array([-2.0, -2.0, 0.0])
    alone = evidence(residual, residual, ways, rows.folds, least[:2], most[:2])
    return alone.after, evidence(residual, residual, both, rows.folds, least, most).after
