"""Errors and commands of one episode over time, as pixels for a film."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib import ticker as mticker
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from pipeline.reaching.metrics import REPORTED_PRECISIONS
from pipeline.reporting.figures.style import INK, REGION, SERIES, StyledFigure

DOTS_PER_INCH = 100
HEIGHT_RATIOS = (1.1, 1.1, 1.0)
FONT_SIZE = 7.5
LOWEST = 1e-3  # m, rad: lower end of the logarithmic axes; smaller errors are drawn there
HALF_ROW = 0.4  # height of a full command in its joint's row of height 1
VEIL = 0.78  # share of white over the future part
CURSOR_COLOUR = (27, 39, 51)


class EpisodeCourse(NamedTuple):
    """One episode of T ticks.

    Attributes:
        t_s: time after each tick, s, shape (T,).
        position_error: m, shape (T,).
        pitch_error: signed, rad, shape (T,).
        command: in [-1, 1], shape (T, n_joint).
    """

    t_s: np.ndarray
    position_error: np.ndarray
    pitch_error: np.ndarray
    command: np.ndarray


class EpisodeChart:
    """The chart of a whole episode, drawn once; `at` fades the part after a given time."""

    def __init__(self, course: EpisodeCourse, joint_names: Sequence[str], width: int, height: int) -> None:
        """Draw the course.

        Args:
            joint_names: n_joint names.
            width: of the picture, pixels.
            height: of the picture, pixels.
        """
        with StyledFigure(width / DOTS_PER_INCH, height / DOTS_PER_INCH) as figure:
            distance, pitch, commands = figure.subplots(3, 1, sharex=True, height_ratios=HEIGHT_RATIOS)
            position_ticks, pitch_ticks = zip(REPORTED_PRECISIONS[0], REPORTED_PRECISIONS[-1], strict=True)
            _draw_error(distance, course.t_s, course.position_error, position_ticks, "distance\n[m]")
            _draw_error(pitch, course.t_s, np.abs(course.pitch_error), pitch_ticks, "pitch error\n[rad]")
            _draw_commands(commands, course, joint_names)
            commands.set_xlim(0.0, course.t_s[-1])
            commands.set_xlabel("time [s]", fontsize=FONT_SIZE)
            figure.align_ylabels()
            self._picture, boxes = _rasterise(figure, [distance, commands], width, height)
        self._left, self._right = boxes[0].x0, boxes[0].x1
        self._rows = slice(round(height - boxes[0].y1), round(height - boxes[1].y0))  # pixels count downwards
        self._duration_s = float(course.t_s[-1])

    def at(self, t_s: float) -> np.ndarray:
        """The chart at a moment, uint8, shape (height, width, 3)."""
        picture = self._picture.copy()
        share = min(t_s / self._duration_s, 1.0)
        cursor = round(self._left + share * (self._right - self._left))
        to_come = picture[self._rows, cursor : round(self._right) + 1]  # a view, written to below
        to_come[:] = (VEIL * 255.0 + (1.0 - VEIL) * to_come.astype(np.float32)).astype(np.uint8)
        picture[self._rows, cursor] = CURSOR_COLOUR
        return picture


def _draw_error(
    axes: Axes, t_s: np.ndarray, error: np.ndarray, thresholds: Sequence[float], label: str
) -> None:
    axes.plot(t_s, np.maximum(error, LOWEST), color=INK, linewidth=1.6)
    axes.set_yscale("log")
    ticks = [*dict.fromkeys(thresholds), 1.0]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks], fontsize=FONT_SIZE - 1)
    axes.yaxis.set_minor_locator(mticker.NullLocator())
    axes.set_ylabel(label, fontsize=FONT_SIZE)
    axes.set_ylim(min(0.01, *thresholds) / 2, max(2.0, 1.3 * float(error.max())))


def _draw_commands(axes: Axes, course: EpisodeCourse, joint_names: Sequence[str]) -> None:
    """A row per joint: forward above its line in blue, backward below it in orange."""
    rows = np.arange(len(joint_names))[::-1]
    for row, command in zip(rows, course.command.T, strict=True):
        for sign, colour in ((1.0, SERIES[0]), (-1.0, SERIES[1])):
            part = sign * np.clip(sign * command, 0.0, 1.0)
            axes.fill_between(course.t_s, row, row + HALF_ROW * part, step="pre", color=colour, linewidth=0.0)
        axes.axhline(row, color=REGION, linewidth=0.5)
    axes.set_yticks(rows, joint_names, fontsize=FONT_SIZE - 1)
    axes.set_ylim(-0.6, len(rows) - 0.4)
    axes.set_ylabel("command", fontsize=FONT_SIZE)
    axes.tick_params(axis="x", labelsize=FONT_SIZE)
    axes.grid(False)


def _rasterise(
    figure: Figure, panels: Sequence[Axes], width: int, height: int
) -> tuple[np.ndarray, list[Bbox]]:
    """Pixels, and the extents of the panels, from the lower left."""
    figure.set_dpi(DOTS_PER_INCH)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = np.asarray(canvas.buffer_rgba())[:height, :width, :3].copy()
    return picture, [panel.get_window_extent() for panel in panels]
