"""Labelled horizontal bars as inline SVG, in the look of `chart.Panel`."""

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.reporting.closed_loop.chart import WIDTH
from pipeline.reporting.closed_loop.quantities import significant
from pipeline.reporting.figures.style import INK, REGION

CHARACTER, VALUES = 6.3, 40  # px: a character of a label, and room for values right of the bars
TOP, ROW, BAR = 26, 20, 11

HALO = 'paint-order="stroke" stroke="#fff" stroke-width="3"'  # keeps values legible on the dashed line


@dataclass(frozen=True)
class Bar:
    """One bar, in the unit in which it is shown.

    Attributes:
        label: Text left of the bar.
        value: Length; NaN omits the bar.
        colour: CSS colour.
        interval: 95 % interval, drawn as a whisker; None if unknown.
    """

    label: str
    value: float
    colour: str
    interval: tuple[float, float] | None = None


def bar_panel(
    title: str, unit: str, bars: Sequence[Bar], reference: float = math.nan, width: int = WIDTH
) -> str:
    """Bars from zero, all on one scale, with a dashed line at the reference.

    Args:
        title: Heading of the panel.
        unit: Unit of all values.
        bars: From top to bottom.
        reference: Position of the dashed line, in the same unit; NaN omits it.
        width: Width of the panel, px.

    Returns:
        An `<svg>` element.
    """
    shown = [bar for bar in bars if math.isfinite(bar.value)]
    ends = [bar.value for bar in shown] + [bar.interval[1] for bar in shown if bar.interval]
    largest = max([end for end in [*ends, reference] if math.isfinite(end)], default=0.0) or 1.0
    left = 10 + CHARACTER * max((len(bar.label) for bar in shown), default=0)
    scale = (width - left - VALUES) / largest
    height = TOP + ROW * len(shown) + 6
    parts = [
        f'<text x="4" y="14" font-weight="600" fill="{INK}">{html.escape(title)}</text>'
        f'<text x="{width - 4}" y="14" text-anchor="end" fill="#5b6b7b">{html.escape(unit)}</text>'
    ]
    values = []
    for i, bar in enumerate(shown):
        y = TOP + ROW * i
        middle = y + BAR / 2
        end = left + scale * bar.value
        parts.append(
            f'<text x="{left - 6:.1f}" y="{y + 10}" text-anchor="end" fill="{INK}">{html.escape(bar.label)}</text>'
        )
        parts.append(
            f'<rect x="{left:.1f}" y="{y}" width="{scale * bar.value:.1f}" height="{BAR}" fill="{bar.colour}"/>'
        )
        if bar.interval and all(math.isfinite(bound) for bound in bar.interval):
            low, high = (left + scale * max(0.0, bound) for bound in bar.interval)
            end = max(end, high)
            parts.append(
                f'<path d="M{low:.1f} {middle}H{high:.1f}M{low:.1f} {y + 2}v7M{high:.1f} {y + 2}v7" stroke="{INK}"/>'
            )
        values.append(
            f'<text x="{end + 5:.1f}" y="{y + 10}" fill="{INK}" {HALO}>{significant(bar.value)}</text>'
        )
    if math.isfinite(reference):
        x = left + scale * reference
        parts.append(
            f'<path d="M{x:.1f} {TOP - 4}V{height - 4}" stroke="{REGION}" stroke-width="1.4" stroke-dasharray="4 3"/>'
        )
    body = "".join([*parts, *values])
    return f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{html.escape(title)}">{body}</svg>'
