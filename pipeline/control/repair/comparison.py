"""Two policies over the same targets: rates, their paired difference, and whether the new one may replace the former.

Interval of the difference: A. Agresti and Y. Min, Simple improved confidence intervals for comparing matched
proportions. Statistics in Medicine 24 (2005). Half a pair is added to each of the four kinds of pairs, so that there is
an interval where no pair differs, too.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.effects.draws import OF_95_PERCENT
from pipeline.reaching.metrics import Traces, success

PRECISION = (0.04, 0.04)  # m, rad
ADDED_PAIRS = 2.0


@dataclass(frozen=True)
class PairedRate:
    """The rate of an event over the same targets.

    Attributes:
        before: Of the former policy.
        after: Of the new one.
        ci95: 95 % interval of the difference `after - before`.
    """

    before: float
    after: float
    ci95: tuple[float, float]

    @classmethod
    def of(cls, before: np.ndarray, after: np.ndarray) -> "PairedRate":
        """Rates of events (N,), boolean, target by target."""
        n = len(before) + ADDED_PAIRS
        lost, won = (np.sum(a & ~b) + 0.25 * ADDED_PAIRS for a, b in ((before, after), (after, before)))
        middle = (won - lost) / n
        half = OF_95_PERCENT * np.sqrt(won + lost - (won - lost) ** 2 / n) / n
        ends = max(float(middle - half), -1.0), min(float(middle + half), 1.0)
        return cls(float(before.mean()), float(after.mean()), ends)

    @property
    def difference(self) -> dict[str, Any]:
        """For JSON."""
        return {"value": self.after - self.before, "ci95": list(self.ci95)}


@dataclass(frozen=True)
class Comparison:
    """The former policy and the new one over the same targets.

    Attributes:
        n_targets: How many.
        success: Within `PRECISION` of the target at one tick at least.
        outside: Outside W+ at one tick at least.
    """

    n_targets: int
    success: PairedRate
    outside: PairedRate

    @classmethod
    def of(cls, before: Traces, after: Traces) -> "Comparison":
        """From traces of the same targets in the same order."""
        return cls(
            len(before.reward),
            PairedRate.of(_reached(before), _reached(after)),
            PairedRate.of(_left(before), _left(after)),
        )

    def verdict(self, margin: float) -> tuple[bool, str]:
        """Whether the new policy may replace the former one, and why or why not.

        It may not be worse by `margin` or more, and must be shown to be better or safer.
        """
        lower, upper = self.success.ci95
        less, more = self.outside.ci95
        if lower <= -margin:
            return False, f"its success rate may be {-100 * lower:.1f} points lower"
        if more >= margin:
            return False, f"it may leave W+ {100 * more:.1f} points more often"
        if lower > 0.0:
            return True, f"its success rate is {100 * lower:.1f} to {100 * upper:.1f} points higher"
        if more < 0.0:
            return True, f"it leaves W+ {-100 * more:.1f} to {-100 * less:.1f} points less often"
        return False, "neither a higher success rate nor fewer departures from W+ are shown"

    def as_dict(self, margin: float) -> dict[str, Any]:
        """For JSON (contract, section 3)."""
        promotable, reason = self.verdict(margin)
        return {
            "sr_before": self.success.before,
            "sr_after": self.success.after,
            "difference": self.success.difference,
            "oow_before": self.outside.before,
            "oow_after": self.outside.after,
            "oow_difference": self.outside.difference,
            "precision": list(PRECISION),
            "n_targets": self.n_targets,
            "promotable": promotable,
            "reason": reason,
        }


def _reached(traces: Traces) -> np.ndarray:
    return np.asarray(success(traces, *PRECISION).any(axis=1))


def _left(traces: Traces) -> np.ndarray:
    return np.asarray((~traces.inside).any(axis=1))
