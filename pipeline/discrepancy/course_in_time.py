"""`other` with `absolute_time`: one joint's speed varies over a session as nothing that was measured explains.

As for a common change of speed (`supply_variation.py`) there is nothing to regress on. What the joint's own residual is
some seconds before and after a row is tried whether it predicts it there; the seconds around the row are left out, in
which any effect of commands or poses would say the same.

Equation: v_j = u_j e^{z_j(t)}, z_j by a kernel's means over time, each without its own neighbourhood; source:
De Brabanter et al. (2011), Kernel Regression in the Presence of Correlated Errors, Journal of Machine Learning
Research 12.
"""

from types import MappingProxyType

import numpy as np
from scipy.signal import fftconvolve

from pipeline.discrepancy.candidate import Candidate, Nominal
from pipeline.discrepancy.change_of_speed import MOST_OF_ESTIMATE, ChangeOfSpeed
from pipeline.discrepancy.regression import evidence
from pipeline.discrepancy.scored_rows import Rows, spread
from pipeline.discrepancy.simulation import Hypothesis, Simulation

FAMILY = "other:absolute_time"
LEFT_OUT_S = 1.5  # to either side: longer than a motion's residual is alike
KERNEL_WIDTHS = 3.0  # to either side


class _Course(ChangeOfSpeed):
    """A joint's change of speed as its own residual shows it at other times."""

    family = FAMILY
    widths_s = (3.0, 6.0, 12.0, 24.0)

    def __init__(
        self, simulation: Simulation, active: Hypothesis, rows: Rows, beside: Rows | None = None
    ) -> None:
        known = sum(spread(of.weight, of.is_used) for of in (rows, beside) if of is not None)
        super().__init__(simulation, active, rows, np.asarray(known))

    def of(self, joint: int, width_s: float) -> np.ndarray:
        """By a kernel's means over the times around, the next seconds left out."""
        half = round(KERNEL_WIDTHS * width_s / self.dt_s)
        distance_s = self.dt_s * np.abs(np.arange(-half, half + 1))
        kernel = np.exp(-0.5 * (distance_s / width_s) ** 2) * (distance_s > LEFT_OUT_S)
        product, square = (
            fftconvolve(of[..., joint], kernel[None], mode="full", axes=1)[:, half:-half]
            for of in (self.product, self.square)
        )
        return self.ratio(product, square, square)


def course_candidates(
    simulation: Simulation, active: Hypothesis, rows: Rows, nominal: Nominal = MappingProxyType({})
) -> list[Candidate]:
    """One candidate per joint, at the best width; arguments as of `ChangeOfSpeed`, and of its `candidates`."""
    return _Course(simulation, active, rows).candidates(nominal)


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
    most = np.full(3, MOST_OF_ESTIMATE)
    least = np.array([-MOST_OF_ESTIMATE, -MOST_OF_ESTIMATE, 0.0])
    alone = evidence(residual, residual, ways, rows.folds, least[:2], most[:2])
    return alone.after, evidence(residual, residual, both, rows.folds, least, most).after
