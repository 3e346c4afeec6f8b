"""End-effector paths of evaluated episodes, from above and from the side."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from pipeline.machine.specification import WorkspaceSpecification
from pipeline.reaching.metrics import PATH_END_PRECISION, Traces, success
from pipeline.reporting.figures.style import INK, SERIES, StyledFigure, frameless, to_png
from pipeline.reporting.figures.workspace import draw_section, draw_sector

REACHED, MISSED = SERIES[0], SERIES[1]
PANEL_WIDTH_IN, PLAN_HEIGHT_IN, SIDE_HEIGHT_IN = 2.7, 2.9, 2.4
LEGEND_WIDTH_IN = 5.6
COLUMNS = 4  # panels per row
LINE_WIDTH, START_SIZE, TARGET_SIZE = 1.1, 3.5, 6.5


class Paths(NamedTuple):
    """Paths of the tip in n episodes.

    Attributes:
        positions: from the start to the tick that reached the target, or to the end, in {B}, m, (T_i + 1, 3) each.
        targets: in {B}, m, shape (n, 3).
        reached: boolean, shape (n,).
    """

    positions: list[np.ndarray]
    targets: np.ndarray
    reached: np.ndarray


def paths_of(traces: Traces, targets: np.ndarray) -> Paths:
    """Paths of the first episodes, up to the tick at which EEF-PL ends.

    Args:
        traces: traces of an evaluation.
        targets: positions of the first n episodes' targets in {B}, m, shape (n, 3).
    """
    reached = success(traces, *PATH_END_PRECISION)[: len(targets)]
    positions = []
    for i, hits in enumerate(reached):
        end = int(np.argmax(hits)) + 1 if hits.any() else len(hits)
        positions.append(np.concatenate([traces.start_position[i][None], traces.position[i, :end]]))
    return Paths(positions, targets, np.array([hits.any() for hits in reached]))


def path_figure(paths: Mapping[str, Paths], workspace: WorkspaceSpecification) -> bytes:
    """Paths by controller: plan view on top, height over the distance from the swing axis below.

    Args:
        paths: paths by controller, of the same episodes.
        workspace: W+, drawn as an outline.

    Returns:
        PNG bytes.
    """
    columns = min(len(paths), COLUMNS)
    bands = -(-len(paths) // columns)
    heights = [PLAN_HEIGHT_IN, SIDE_HEIGHT_IN] * bands
    with StyledFigure(max(PANEL_WIDTH_IN * columns, LEGEND_WIDTH_IN), sum(heights) + 0.5) as figure:
        panels = figure.subplots(2 * bands, columns, squeeze=False, height_ratios=heights)
        for index, (controller, ways) in enumerate(paths.items()):
            band, column = divmod(index, columns)
            above, beside = panels[2 * band : 2 * band + 2, column]
            draw_sector(above, workspace)
            draw_section(beside, workspace)
            _draw_paths(above, beside, ways)
            above.set_title(controller)
            above.set_xlabel("x, forward [m]")
            beside.set_xlabel("distance from swing axis [m]")
            if column == 0:
                above.set_ylabel("y, left [m]")
                beside.set_ylabel("z, up [m]")
        for empty in panels.reshape(bands, 2, columns)[-1][:, len(paths) - columns * (bands - 1) :].ravel():
            empty.set_visible(False)
        figure.legend(handles=_legend(), loc="outside upper right", ncols=4)
        return to_png(figure)


def _draw_paths(above: Axes, beside: Axes, ways: Paths) -> None:
    for axes, project in ((above, _plan), (beside, _side)):
        for position, target, reached in zip(ways.positions, ways.targets, ways.reached, strict=True):
            colour, dashes = (REACHED, "-") if reached else (MISSED, (0, (3, 1)))
            across, up = project(position)
            axes.plot(across, up, color=colour, linestyle=dashes, linewidth=LINE_WIDTH)
            axes.plot(across[0], up[0], "o", color=colour, markersize=START_SIZE)
            axes.plot(*project(target), "+", color=INK, markersize=TARGET_SIZE, markeredgewidth=1.3)
        axes.set_aspect("equal")
        frameless(axes)


def _plan(position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return position[..., 0], position[..., 1]


def _side(position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.hypot(position[..., 0], position[..., 1]), position[..., 2]


def _legend() -> list[Line2D]:
    position, pitch = PATH_END_PRECISION
    within = f"within {position:g} m, {pitch:g} rad"
    return [
        Line2D([], [], color=REACHED, label=f"reached {within}"),
        Line2D([], [], color=MISSED, linestyle=(0, (3, 1)), label="not reached"),
        Line2D([], [], color=REACHED, marker="o", markersize=START_SIZE, linestyle="", label="start"),
        Line2D([], [], color=INK, marker="+", markersize=TARGET_SIZE, linestyle="", label="target"),
    ]
