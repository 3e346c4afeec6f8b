"""Learning curves: a policy's metrics over training steps."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.reaching.metrics import ReachingMetrics


@dataclass(frozen=True)
class CurvePoint:
    """Point of a learning curve: steps trained so far, and the deterministic policy's metrics."""

    steps: int
    metrics: ReachingMetrics

    @property
    def shown(self) -> str:
        """For the terminal."""
        metrics = self.metrics
        return f"after {self.steps} ticks SR(0.04, 0.04) {metrics.sr_004_004:.2f}, OOW {metrics.oow:.2f}"


def write_curve(path: Path, curve: Sequence[CurvePoint]) -> None:
    """Write a curve as CSV: a column `steps` and one per metric, one row per point."""
    rows = [{"steps": point.steps, **point.metrics.as_dict()} for point in curve]
    with Path(path).open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
