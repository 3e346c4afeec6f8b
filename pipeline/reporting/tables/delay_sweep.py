"""What longer delays of the loop cost a controller, as a table (Sim2Sim)."""

from collections.abc import Mapping
from typing import Any

from pipeline.reporting.figures.delay_sweep import PER_S, RATES
from pipeline.reporting.table import Table


def delay_sweep_table(swept: Mapping[float, Mapping[str, Any]]) -> Table:
    """A row per delay that was added, s, with its metrics of `ReachingMetrics`."""
    rows = [
        [
            f"{PER_S * delay_s:.0f}",
            *(f"{metrics[metric]:.2f}" for metric in RATES),
            f"{metrics['path_length_m']:.2f}",
            str(metrics["n_episodes"]),
        ]
        for delay_s, metrics in swept.items()
    ]
    return Table(
        "A controller through the graph, with delays added to those measured",
        ["Added [ms]", *RATES.values(), "EEF-PL [m]", "Episodes"],
        rows,
        [
            "The learned model in the machine's place. Joint states take half of what is added; each of a command's "
            "two ways takes a quarter.",
        ],
    )
