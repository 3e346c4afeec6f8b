"""Agreement of the simulated and the real graph: differences between trials of the same targets."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from pipeline.errors import InputError
from pipeline.files.atomic import write_json, write_whole

CONFIDENCE = 0.95
COMPARED = {  # metric of a trial (`pipeline.reaching.logged_trials.reaching_summary`) -> its name in tables
    "sr_002_002": "SR(0.02, 0.02)",
    "sr_004_004": "SR(0.04, 0.04)",
    "sr_012_008": "SR(0.12, 0.08)",
    "oow": "OOW",
    "path_length_m": "path, m",
    "nearest_position_error_m": "least distance, m",
    "final_position_error_m": "distance at the end, m",
    "final_pitch_error_rad": "pitch error at the end, rad",
}
RATES = ("sr_002_002", "sr_004_004", "sr_012_008", "oow")
SAME_POSITION_M = 1e-6
RULE_OF_THREE = 3.0  # upper 95 % bound on the count of events that did not occur in n trials
Trials = Sequence[Mapping[str, Any]]


class PairedDifference(NamedTuple):
    """One metric: means on both graphs, and the mean difference, real minus simulated, with its interval.

    Attributes:
        real: mean on the real graph.
        simulated: mean in simulated time.
        difference: mean over the pairs.
        half_width: half width of its 95 % interval: Student's t over the pairs; 3/n, the rule of three, for a rate
            that is equal in all pairs; infinite for a single pair.
        n: number of pairs.
    """

    real: float
    simulated: float
    difference: float
    half_width: float
    n: int

    @property
    def contains_zero(self) -> bool:
        """Whether the pairs are compatible with a zero difference."""
        return abs(self.difference) <= self.half_width


def write_agreement(output: Path, real: Trials, simulated: Trials) -> str:
    """Write `agreement.json` and `agreement.md`, and give the table that is in the latter."""
    differences = paired_differences(real, simulated)
    content = {name: row._asdict() for name, row in differences.items()}
    write_json(output / "agreement.json", content)
    table = agreement_table(differences)
    write_whole(output / "agreement.md", table.encode())
    return table


def paired_differences(real: Trials, simulated: Trials) -> dict[str, PairedDifference]:
    """Paired differences per metric of `COMPARED`.

    Args:
        real: trials on the real graph, in the order of the targets.
        simulated: the same targets in simulated time.

    Raises:
        InputError: the trials do not have the same targets, or are empty.
    """
    first, second = (
        np.array([trial["target_position_m"] for trial in trials], float) for trials in (real, simulated)
    )
    if not real or len(real) != len(simulated) or not np.allclose(first, second, atol=SAME_POSITION_M):
        raise InputError(
            f"{len(real)} trials on the real graph and {len(simulated)} in simulated time are not of the same targets"
        )
    return {name: _difference(real, simulated, metric) for metric, name in COMPARED.items()}


def _difference(real: Trials, simulated: Trials, metric: str) -> PairedDifference:
    # errors of angles are signed; only their size counts
    first, second = (np.abs([float(trial[metric]) for trial in trials]) for trials in (real, simulated))
    differences = first - second
    n = len(differences)
    half_width = math.inf
    if n > 1:
        factor = float(stats.t.ppf(0.5 + CONFIDENCE / 2, n - 1))
        half_width = factor * float(differences.std(ddof=1)) / math.sqrt(n)
        if metric in RATES and not differences.any():
            half_width = RULE_OF_THREE / n
    return PairedDifference(
        float(first.mean()), float(second.mean()), float(differences.mean()), half_width, n
    )


def agreement_table(differences: Mapping[str, PairedDifference]) -> str:
    """Markdown: a row per metric."""
    n = next(iter(differences.values())).n
    lines = [
        f"| {n} pairs | real graph | simulated | difference, 95 % interval |",
        "|---|---|---|---|",
    ]
    for name, row in differences.items():
        span = f"{row.difference:+.3f} ± {row.half_width:.3f}" + ("" if row.contains_zero else " (not zero)")
        lines.append(f"| {name} | {row.real:.3f} | {row.simulated:.3f} | {span} |")
    return "\n".join(lines) + "\n"
