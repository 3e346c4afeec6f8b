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
from scipy.ndimage import gaussian_filter1d

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows, spread
from pipeline.discrepancy.diagnosis.simulation import Hypothesis, Simulation
from pipeline.discrepancy.families.change_of_speed import MOST_OF_ESTIMATE, ChangeOfSpeed
from pipeline.discrepancy.selection.candidate import Candidate, Nominal
from pipeline.discrepancy.selection.regression import evidence

FAMILY = "other:absolute_time"
PERIOD = "period"  # of a cycle, s, in its candidate's point
LEFT_OUT_S = 1.5  # to either side: longer than a motion's residual is alike
KERNEL_WIDTHS = 3.0  # to either side
SHORTEST_PERIOD_S, LONGEST_PERIOD_S = 15.0, 120.0  # of a cycle
FEWEST_ROUNDS = 3.0  # in the longest log, for a cycle to be one
N_PERIODS = 3  # that are tried
SHARE_OF_PERIOD = 0.05  # the kernel's width: a cycle may be a switch
# Of what varies: a cycle has to explain so much more than a smooth course, and so much of what constants leave.
CYCLE_FACTOR, CYCLE_SHARE = 1.05, 0.1
OVERSAMPLING = 16  # of the periodogram: a period that is off adds up over rounds
SLOW_S = 60.0  # what varies no faster is no cycle
# Times the band's median: work that comes round has a period, too, in which commands and poses say the same.
WORK_FACTOR = 10.0


class _Course(ChangeOfSpeed):
    """A joint's change of speed as its residual shows it at other times, of a cycle at the same phase of its rounds."""

    family = FAMILY
    widths_s = (3.0, 6.0, 12.0, 24.0)

    def __init__(
        self, simulation: Simulation, active: Hypothesis, rows: ScoredRows, beside: ScoredRows | None = None
    ) -> None:
        known = sum(spread(of.weight, of.is_used) for of in (rows, beside) if of is not None)
        super().__init__(simulation, active, rows, np.asarray(known))

    def options(self, joint: int) -> list[Candidate]:
        """Any course, at the best width; instead of it a cycle, where that explains clearly more of what varies."""
        smooth = max(super().options(joint), key=lambda option: option.gain)
        cycles = [
            {"width": SHARE_OF_PERIOD * period_s, PERIOD: period_s} for period_s in self._periods_s(joint)
        ]
        if not cycles:
            return [smooth]
        left, *of_cycles = (self.residuals(joint, shape) for shape in (smooth.point, *cycles))
        constant = float(np.sum(left[0] ** 2))
        of_smooth, *varying = (constant - float(np.sum(after**2)) for _, after in (left, *of_cycles))
        best = int(np.argmax(varying))
        is_cycle = varying[best] > max(CYCLE_FACTOR * of_smooth, CYCLE_SHARE * constant)
        return [self.candidate(joint, cycles[best]) if is_cycle else smooth]

    def of(self, joint: int, width: float, period: float | None = None) -> np.ndarray:
        """By a kernel's means over the seconds around, the nearest left out; of a cycle over all its other rounds."""
        from scipy.signal import fftconvolve  # takes 0.4 s, which nodes that only name the family do without

        kernel = self._around(width) if period is None else self._at_the_same_phase(width, period)
        half = len(kernel) // 2
        product, square = (
            fftconvolve(of[..., joint], kernel[None], mode="full", axes=1)[:, half : half + of.shape[1]]
            for of in (self.product, self.square)
        )
        return self.ratio(product, square, square)

    def residuals(self, joint: int, shape: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """(N,) what the best constant ratio of either direction leaves, and what the course leaves of it."""
        residual, moving = self.reference[:, joint], self.velocity[..., joint]
        ways = np.stack([self.regressor(joint, way) for way in (moving > 0.0, moving < 0.0)], axis=1)
        both = np.column_stack([ways, self.regressor(joint, self.of(joint, **shape))])
        most = np.full(3, MOST_OF_ESTIMATE)
        least = np.array([-MOST_OF_ESTIMATE, -MOST_OF_ESTIMATE, 0.0])
        folds = self.rows.folds
        alone = evidence(residual, residual, ways, folds, least[:2], most[:2])
        return alone.after, evidence(residual, residual, both, folds, least, most).after

    def _around(self, width: float) -> np.ndarray:
        half = round(KERNEL_WIDTHS * width / self.dt_s)
        time_s = self.dt_s * np.arange(-half, half + 1)
        return (np.abs(time_s) > LEFT_OUT_S) * np.exp(-0.5 * (time_s / width) ** 2)

    def _at_the_same_phase(self, width: float, period: float) -> np.ndarray:
        half = self.product.shape[1] - 1
        time_s = self.dt_s * np.arange(-half, half + 1)
        rounds = np.rint(time_s / period)
        return (rounds != 0) * np.exp(-0.5 * ((time_s - period * rounds) / width) ** 2)

    def _periods_s(self, joint: int) -> list[float]:
        """Of the highest peaks of the periodogram of what a slow course leaves, but for those of the work itself."""
        product, square = self.product[..., joint], self.square[..., joint]
        slow = [gaussian_filter1d(of, SLOW_S / self.dt_s, axis=1) for of in (product, square)]
        left = product - slow[0] / np.maximum(slow[1], 1e-9) * square
        n = OVERSAMPLING * left.shape[1]
        frequency = np.fft.rfftfreq(n, self.dt_s)
        longest_s = self.dt_s * max(np.ptp(np.append(np.flatnonzero(of), 0)) for of in square > 0.0)
        slowest = max(FEWEST_ROUNDS / max(longest_s, self.dt_s), 1.0 / LONGEST_PERIOD_S)
        within = (frequency >= slowest) & (frequency <= 1.0 / SHORTEST_PERIOD_S)
        power, *of_work = (
            _power(of, n)
            for of in (left, *np.moveaxis(self.velocity, -1, 0), *np.moveaxis(self.square, -1, 0))
        )
        if not within.any():
            return []
        is_work = np.any([of > WORK_FACTOR * np.median(of[within]) for of in of_work], axis=0)
        from scipy.signal import find_peaks

        peaks = find_peaks(power, distance=max(1, round(n * self.dt_s / longest_s)))[0]
        peaks = peaks[within[peaks] & ~is_work[peaks]]
        highest = peaks[np.argsort(-power[peaks])[:N_PERIODS]]
        return [float(1.0 / of) for of in frequency[highest]]


def _power(signal: np.ndarray, n: int) -> np.ndarray:
    """Periodogram of (B, T), each log's mean removed, all logs' powers added; zeros to `n` rows."""
    return np.sum(np.abs(np.fft.rfft(signal - signal.mean(axis=1, keepdims=True), n, axis=1)) ** 2, axis=0)


def course_candidates(
    simulation: Simulation, active: Hypothesis, rows: ScoredRows, nominal: Nominal = MappingProxyType({})
) -> list[Candidate]:
    """One candidate per joint, of the best shape; arguments as of `ChangeOfSpeed`, and of its `candidates`."""
    return _Course(simulation, active, rows).candidates(nominal)


def beyond_constants(
    simulation: Simulation,
    active: Hypothesis,
    rows: ScoredRows,
    beside: ScoredRows | None,
    joint: int,
    shape: Mapping[str, float],
) -> tuple[np.ndarray, np.ndarray]:
    """What the best constant ratio of either direction leaves, which is no course, and what the course leaves of it.

    Not a course that is shifted in time: one that comes round again explains as much a period later.

    Args:
        simulation: On the logs.
        active: Effects beside it.
        rows: Rows on which it is scored.
        beside: Further rows that tell of the course, if any.
        joint: Index.
        shape: `point` of its candidate.

    Returns:
        (N,) residuals without and with the course.
    """
    return _Course(simulation, active, rows, beside).residuals(joint, shape)
