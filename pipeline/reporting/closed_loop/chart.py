"""A small chart as inline SVG: one panel of a grid that wraps on narrow pages.

A report holds dozens of panels, so they are written directly instead of with Matplotlib. Each takes a millisecond and a
few kilobytes, its text stays text, and panels wrap on a small screen.
"""

import html
import math
from collections.abc import Sequence

import numpy as np

from pipeline.reporting.figures.style import INK, REGION

WIDTH, WIDE, HEIGHT = (
    260,
    380,
    170,
)  # px; text has the page's size with four, or two, panels in a row
LEFT, RIGHT, TOP, BOTTOM = 38, 8, 24, 34  # margins, px
GRID = "#e3e8ed"
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)  # tick distances within a decade


class Panel:
    """Axes with marks; positions are in the axes' units."""

    def __init__(
        self,
        title: str,
        x_range: tuple[float, float],
        y_range: tuple[float, float],
        x_label: str = "",
        y_label: str = "",
        height: int = HEIGHT,
        width: int = WIDTH,
    ) -> None:
        self.width = width
        self.title, self.x_label, self.y_label, self.height = title, x_label, y_label, height
        self.x_range, self.y_range = _opened(x_range), _opened(y_range)
        self._marks: list[str] = []

    def band(self, begin: float, end: float, colour: str) -> None:
        """Shades a stretch of the abscissa."""
        x = np.clip([begin, end], *self.x_range)
        left, right = self._x(float(x[0])), self._x(float(x[1]))
        self._marks.append(
            f'<rect x="{left:.1f}" y="{TOP}" width="{max(0.0, right - left):.1f}" height="{self._depth}" '
            f'fill="{colour}"/>'
        )

    def line(self, x: np.ndarray, y: np.ndarray, colour: str, dash: str = "", width: float = 1.5) -> None:
        """A line that breaks where a value is missing."""
        path, pen = [], "M"
        for a, b in zip(x, y, strict=True):
            if not (math.isfinite(a) and math.isfinite(b)):
                pen = "M"
                continue
            path.append(f"{pen}{self._x(a):.1f} {self._y(b):.1f}")
            pen = "L"
        if path:
            dashes = f' stroke-dasharray="{dash}"' if dash else ""
            self._marks.append(
                f'<path d="{"".join(path)}" fill="none" stroke="{colour}" stroke-width="{width}"{dashes}/>'
            )

    def level(self, y: float, colour: str = REGION, dash: str = "4 3") -> None:
        """A horizontal line all through the panel."""
        self.line(np.array(self.x_range), np.array([y, y]), colour, dash, 1.2)

    def dots(
        self,
        x: np.ndarray,
        y: np.ndarray,
        colour: str,
        hollow: bool = False,
        half_widths: np.ndarray | None = None,
    ) -> None:
        """Dots, with vertical error bars if half widths are given."""
        for i, (a, b) in enumerate(zip(x, y, strict=True)):
            if not (math.isfinite(a) and math.isfinite(b)):
                continue
            if half_widths is not None and math.isfinite(half_widths[i]):
                low, high = self._y(b - half_widths[i]), self._y(b + half_widths[i])
                self._marks.append(
                    f'<path d="M{self._x(a):.1f} {low:.1f}V{high:.1f}" stroke="{colour}" stroke-width="1.1"/>'
                )
            fill = "#fff" if hollow else colour
            self._marks.append(
                f'<circle cx="{self._x(a):.1f}" cy="{self._y(b):.1f}" r="3" fill="{fill}" stroke="{colour}" '
                f'stroke-width="1.3"/>'
            )

    def svg(self) -> str:
        """The panel as an `<svg>` element."""
        parts = [_text(4, 14, self.title, weight=600)]
        for tick in ticks(*self.y_range, 4):
            y = self._y(tick)
            parts.append(f'<path d="M{LEFT} {y:.1f}H{self.width - RIGHT}" stroke="{GRID}"/>')
            parts.append(_text(LEFT - 5, y + 4, f"{tick:g}".replace("-", "−"), "end"))
        for tick in ticks(*self.x_range, 4):
            x = self._x(tick)
            parts.append(f'<path d="M{x:.1f} {TOP + self._depth}v4" stroke="{REGION}"/>')
            parts.append(_text(x, TOP + self._depth + 15, f"{tick:g}".replace("-", "−"), "middle"))
        frame = f'<path d="M{LEFT} {TOP}V{TOP + self._depth}H{self.width - RIGHT}" fill="none" stroke="{REGION}"/>'
        labels = [_text((LEFT + self.width - RIGHT) / 2, self.height - 4, self.x_label, "middle", soft=True)]
        if self.y_label:
            labels.append(_text(self.width - RIGHT, 14, self.y_label, "end", soft=True))
        # Shading first, then the grid, then lines and dots.
        shading = [mark for mark in self._marks if mark.startswith("<rect")]
        marks = [mark for mark in self._marks if not mark.startswith("<rect")]
        body = "".join([*shading, *parts, frame, *marks, *labels])
        head = f'<svg viewBox="0 0 {self.width} {self.height}" role="img" aria-label="{html.escape(self.title)}">'
        return f"{head}{body}</svg>"

    @property
    def _depth(self) -> int:
        return self.height - TOP - BOTTOM

    def _x(self, value: float) -> float:
        low, high = self.x_range
        return LEFT + (float(np.clip(value, low, high)) - low) / (high - low) * (self.width - LEFT - RIGHT)

    def _y(self, value: float) -> float:
        low, high = self.y_range
        return TOP + (high - float(np.clip(value, low, high))) / (high - low) * self._depth


def ticks(low: float, high: float, wanted: int) -> list[float]:
    """Round values within the range, about as many as wanted."""
    raw = (high - low) / max(1, wanted)
    decade = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * decade for factor in _STEPS if factor * decade >= 0.75 * raw)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [round(i * step, 12) for i in range(first, last + 1)]


def span(values: Sequence[np.ndarray | float], margin: float = 0.08) -> tuple[float, float]:
    """Range of all finite values with a margin; (0, 1) without finite values."""
    flat = np.concatenate([np.ravel(np.asarray(value, float)) for value in values]) if values else np.zeros(0)
    flat = flat[np.isfinite(flat)]
    if not len(flat):
        return 0.0, 1.0
    low, high = float(flat.min()), float(flat.max())
    room = margin * (high - low)
    return low - room, high + room


def _opened(limits: tuple[float, float]) -> tuple[float, float]:
    low, high = (float(value) for value in limits)
    return (low, high) if high > low else (low - 0.5, low + 0.5)


def _text(x: float, y: float, text: str, anchor: str = "start", weight: int = 400, soft: bool = False) -> str:
    colour = "#5b6b7b" if soft else INK
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-weight="{weight}" fill="{colour}">'
        f"{html.escape(text)}</text>"
    )
