"""Large differences between our figures and the paper's, with possible reasons."""

import statistics
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from pipeline.reporting.results.paper import METRIC_COLUMNS, Published

# A difference is reported if it exceeds both thresholds: combined standard deviations, and a practical size (20 reward
# units of 500 ticks, one episode in twenty, 5 cm of depth, 20 cm of path).
DEVIATIONS = 2.0
PRACTICAL_THRESHOLDS = {
    "average_return": 20.0,
    "sr_002_002": 0.05,
    "sr_004_004": 0.05,
    "oow": 0.05,
    "ooz": 0.05,
    "min_z_m": 0.05,
    "path_length_m": 0.2,
}
PRECISION = (
    "average_return",
    "sr_002_002",
    "sr_004_004",
    "path_length_m",
)  # metrics that training and planning improve


class Circumstances(NamedTuple):
    """Differences between our controller and the paper's, as clauses.

    Attributes:
        budget: less training, planning or fewer episodes; empty if ours is not smaller.
        machine: difference between the machines.
    """

    budget: str
    machine: str


def difference_sentences(
    title: str,
    ours: Mapping[str, Sequence[float]],
    published: Mapping[str, Published],
    circumstances: Circumstances,
) -> list[str]:
    """A sentence per large difference.

    Args:
        title: title of the controller.
        ours: a value per seed, by metric.
        published: the paper's figures, by metric.
        circumstances: possible explanations.
    """
    sentences = []
    for metric, figure in published.items():
        values = ours[metric]
        mean = statistics.fmean(values)
        if not is_large(metric, values, figure):
            continue
        direction = "higher" if mean > figure.mean else "lower"
        sentences.append(
            f"{title}, {METRIC_COLUMNS[metric]}: ours is {mean:.2f}, {direction} than the paper's "
            f"{figure.mean:.2f} by {abs(mean - figure.mean):.2f}. {_reason(metric, mean, figure, circumstances)}"
        )
    return sentences


def is_large(metric: str, values: Sequence[float], published: Published) -> bool:
    """Whether the difference of means exceeds the scatter over seeds and the practical threshold."""
    deviation = statistics.stdev(values) if len(values) > 1 else 0.0
    combined = (deviation**2 + published.deviation**2) ** 0.5
    difference = abs(statistics.fmean(values) - published.mean)
    return difference > DEVIATIONS * combined and difference > PRACTICAL_THRESHOLDS[metric]


def _reason(metric: str, mean: float, published: Published, circumstances: Circumstances) -> str:
    # A path is longer if the arm searches and shorter if it hardly moves; other metrics worsen with less training.
    explained = metric == "path_length_m" or mean < published.mean
    if metric in PRECISION and circumstances.budget and explained:
        return f"That may be the budget: {circumstances.budget}; or the machine: {circumstances.machine}."
    return f"That may be the machine: {circumstances.machine}."
