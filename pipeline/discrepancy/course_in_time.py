"""`other` with `absolute_time`: one joint's speed varies over a session as nothing that was measured explains.

As for a common change of speed (`supply_variation.py`) there is nothing to regress on. What the joint's own residual is
some seconds before and after a row is tried whether it predicts it there; the seconds around the row are left out, in
which any effect of commands or poses would say the same. What comes round, as a timer that switches something, is told
by the same phase of all other rounds, which says more than the seconds around.

Equation: v_j = u_j e^{z_j(t)}, z_j by a kernel's means over time, each without its own neighbourhood; source:
De Brabanter et al. (2011), Kernel Regression in the Presence of Correlated Errors, Journal of Machine Learning
Research 12.
"""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from scipy.signal import fftconvolve, find_peaks

from pipeline.discrepancy.candidate import Candidate, Nominal
from pipeline.discrepancy.change_of_speed import MOST_OF_ESTIMATE, ChangeOfSpeed
from pipeline.discrepancy.regression import evidence
from pipeline.discrepancy.scored_rows import Rows, spread
from pipeline.discrepancy.simulation import Hypothesis, Simulation

FAMILY = "other:absolute_time"
PERIOD = "period"  # of a cycle, s, in its candidate's point
LEFT_OUT_S = 1.5  # to either side: longer than a motion's residual is alike
KERNEL_WIDTHS = 3.0  # to either side
SHORTEST_PERIOD_S, LONGEST_PERIOD_S = 15.0, 120.0  # of a cycle; shorter ones are those of work
FEWEST_ROUNDS = 3.0  # in a log, for a cycle to be one
N_PERIODS = 3  # that are tried
SHARE_OF_PERIOD = 0.05  # the kernel's width: a cycle may be a switch
OVERSAMPLING = 16  # of the periodogram: a period that is off adds up over rounds


class _Course(ChangeOfSpeed):
    """A joint's change of speed as its residual shows it at other times, of a cycle at the same phase of its rounds."""

    family = FAMILY
    widths_s = (3.0, 6.0, 12.0, 24.0)

    def __init__(
        self, simulation: Simulation, active: Hypothesis, rows: Rows, beside: Rows | None = None
    ) -> None:
        known = sum(spread(of.weight, of.is_used) for of in (rows, beside) if of is not None)
        super().__init__(simulation, active, rows, np.asarray(known))

    def shapes(self, joint: int) -> list[dict[str, float]]:
        """Any course, and the cycles that stand out."""
        cycles = [
            {"width": SHARE_OF_PERIOD * period_s, PERIOD: period_s} for period_s in self._periods_s(joint)
        ]
        return super().shapes(joint) + cycles

    def of(self, joint: int, width: float, period: float = 0.0) -> np.ndarray:
        """By a kernel's means over the times around, the next seconds left out; of a cycle over all other rounds."""
        half = round(KERNEL_WIDTHS * width / self.dt_s) if not period else self.product.shape[1] - 1
        time_s = self.dt_s * np.arange(-half, half + 1)
        rounds = np.rint(time_s / period) if period else np.zeros(len(time_s))
        is_elsewhere = rounds != 0 if period else np.abs(time_s) > LEFT_OUT_S
        kernel = is_elsewhere * np.exp(-0.5 * ((time_s - period * rounds) / width) ** 2)
        product, square = (
            fftconvolve(of[..., joint], kernel[None], mode="full", axes=1)[:, half : half + of.shape[1]]
            for of in (self.product, self.square)
        )
        return self.ratio(product, square, square)

    def _periods_s(self, joint: int) -> list[float]:
        """Of the highest peaks of the periodogram of what a constant ratio leaves, all logs' powers added."""
        product, square = self.product[..., joint], self.square[..., joint]
        ratio = product.sum(axis=1) / np.maximum(square.sum(axis=1), 1e-9)
        left = product - ratio[:, None] * square
        n = OVERSAMPLING * left.shape[1]
        power = np.sum(np.abs(np.fft.rfft(left, n, axis=1)) ** 2, axis=0)
        frequency = np.fft.rfftfreq(n, self.dt_s)
        slowest = max(FEWEST_ROUNDS / (self.dt_s * left.shape[1]), 1.0 / LONGEST_PERIOD_S)
        peaks = find_peaks(power)[0]
        peaks = peaks[(frequency[peaks] >= slowest) & (frequency[peaks] <= 1.0 / SHORTEST_PERIOD_S)]
        highest = peaks[np.argsort(-power[peaks])[:N_PERIODS]]
        return [float(1.0 / of) for of in frequency[highest]]


def course_candidates(
    simulation: Simulation, active: Hypothesis, rows: Rows, nominal: Nominal = MappingProxyType({})
) -> list[Candidate]:
    """One candidate per joint, of the best shape; arguments as of `ChangeOfSpeed`, and of its `candidates`."""
    return _Course(simulation, active, rows).candidates(nominal)


def beyond_constants(
    simulation: Simulation,
    active: Hypothesis,
    rows: Rows,
    beside: Rows,
    joint: int,
    shape: Mapping[str, float],
) -> tuple[np.ndarray, np.ndarray]:
    """What the best constant ratio of either direction leaves, which is no course, and what the course leaves of it.

    Not a course that is shifted in time: one that comes round again explains as much a period later.

    Args:
        simulation: On the logs.
        active: Effects beside it.
        rows: Rows on which it is scored.
        beside: Further rows that tell of the course.
        joint: Index.
        shape: `point` of its candidate.

    Returns:
        (N,) residuals without and with the course.
    """
    course = _Course(simulation, active, rows, beside)
    residual = course.reference[:, joint]
    moving = course.velocity[..., joint]
    ways = np.stack([course.regressor(joint, way) for way in (moving > 0.0, moving < 0.0)], axis=1)
    both = np.column_stack([ways, course.regressor(joint, course.of(joint, **shape))])
    most = np.full(3, MOST_OF_ESTIMATE)
    least = np.array([-MOST_OF_ESTIMATE, -MOST_OF_ESTIMATE, 0.0])
    alone = evidence(residual, residual, ways, rows.folds, least[:2], most[:2])
    return alone.after, evidence(residual, residual, both, rows.folds, least, most).after
