"""What longer delays of the loop cost a controller (Sim2Sim)."""

from collections.abc import Mapping
from typing import Any

from pipeline.reporting.figures.style import SERIES, SERIES_DASHES, StyledFigure, to_svg

WIDTH_IN, HEIGHT_IN = 8.0, 2.8
RATES = {
    "sr_002_002": "SR(0.02, 0.02)",
    "sr_004_004": "SR(0.04, 0.04)",
    "sr_012_008": "SR(0.12, 0.08)",
    "oow": "OOW",
}
PER_S = 1000.0  # ms


def delay_sweep_figure(swept: Mapping[float, Mapping[str, Any]]) -> bytes:
    """Rates and path length over the delay that was added, as SVG.

    Args:
        swept: Metrics of `ReachingMetrics` by the delay, s.
    """
    delays_ms = [PER_S * delay_s for delay_s in swept]
    with StyledFigure(WIDTH_IN, HEIGHT_IN) as figure:
        rates, path = figure.subplots(1, 2, width_ratios=(3, 2))
        for (metric, label), colour, dashes in zip(RATES.items(), SERIES, SERIES_DASHES, strict=False):
            values = [metrics[metric] for metrics in swept.values()]
            rates.plot(delays_ms, values, marker="o", color=colour, linestyle=dashes, label=label)
        rates.set_ylim(0.0, 1.05)
        rates.set_title("Share of episodes")
        rates.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=4)
        lengths = [metrics["path_length_m"] for metrics in swept.values()]
        path.plot(delays_ms, lengths, marker="o", color=SERIES[0])
        path.set_ylim(bottom=0.0)
        path.set_title("Path of the tip [m]")
        for axes in (rates, path):
            axes.set_xlabel("delay added to the loop [ms]")
        return to_svg(figure)
