"""What a loop and a repair change, on one picture: bars before and after."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pipeline.reporting.figures.style import INK, REGION, SERIES, StyledFigure, to_svg

WIDTH_IN, HEIGHT_IN = 8.0, 2.6
BAR_HEIGHT = 0.38


class BeforeAfter(NamedTuple):
    """One panel.

    Attributes:
        title: Heading, with the unit.
        names: Of the two bars of each row.
        rows: By label the values before and after.
        limit: End of the axis; None: that of the data.
    """

    title: str
    names: tuple[str, str]
    rows: Mapping[str, tuple[float, float]]
    limit: float | None = None


def before_after_figure(panels: Sequence[BeforeAfter]) -> bytes:
    """Pairs of bars, panel by panel, as SVG."""
    with StyledFigure(WIDTH_IN, HEIGHT_IN) as figure:
        all_axes = figure.subplots(1, len(panels), squeeze=False)[0]
        for axes, panel in zip(all_axes, panels, strict=True):
            place = np.arange(len(panel.rows))
            for index, (name, colour) in enumerate(zip(panel.names, (REGION, SERIES[0]), strict=True)):
                values = [pair[index] for pair in panel.rows.values()]
                bars = axes.barh(
                    place + (index - 0.5) * BAR_HEIGHT, values, BAR_HEIGHT, color=colour, label=name
                )
                axes.bar_label(bars, fmt="%.3g", padding=2, color=INK)
            axes.set_yticks(place, list(panel.rows))
            axes.invert_yaxis()
            axes.margins(x=0.15)
            if panel.limit is not None:
                axes.set_xlim(0.0, panel.limit)
            axes.set_title(panel.title)
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)
        return to_svg(figure)
