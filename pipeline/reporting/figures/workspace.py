"""Pictures of chisel-tip positions: the paper's figures of data collection and of sampled poses."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from pipeline.machine.specification import WorkspaceSpecification
from pipeline.reporting.figures.style import DIVERGING_MAP, REGION, StyledFigure, frameless, to_png

ARC_POINTS = 61
POINT_AREA, FEWEST_POINTS = 1.2, 2000  # points²; fewer points are larger, of the same area together
PANEL_WIDTH_IN, PANEL_HEIGHT_IN, COLOUR_BAR_WIDTH_IN = 2.2, 5.6, 1.4


class Cloud(NamedTuple):
    """Poses of the chisel tip, in any order.

    Attributes:
        position: in {B}, m, shape (n, 3).
        pitch: rad, shape (n,).
    """

    position: np.ndarray
    pitch: np.ndarray


def cloud_figure(clouds: Mapping[str, Cloud], workspace: WorkspaceSpecification) -> bytes:
    """End-effector positions coloured by pitch, from above and from the side; a column per recording.

    The side view shows height over the distance from the swing axis.
    The outline is W+ (paper, figures "End effector trajectories ..." and "Sampled end-effector poses ...").

    Args:
        clouds: poses by title of the column.
        workspace: W+.

    Returns:
        PNG bytes.
    """
    bound = max(float(np.abs(cloud.pitch).max()) for cloud in clouds.values())
    with StyledFigure(PANEL_WIDTH_IN * len(clouds) + COLOUR_BAR_WIDTH_IN, PANEL_HEIGHT_IN) as figure:
        panels = figure.subplots(2, len(clouds), squeeze=False, sharex="row", sharey="row")
        for column, (title, cloud) in enumerate(clouds.items()):
            x, y, z = cloud.position.T
            above, beside = panels[:, column]
            draw_sector(above, workspace)
            draw_section(beside, workspace)
            for axes, across, up in ((above, x, y), (beside, np.hypot(x, y), z)):
                marks = axes.scatter(
                    across,
                    up,
                    c=cloud.pitch,
                    s=POINT_AREA * max(1.0, FEWEST_POINTS / len(x)),
                    linewidths=0.0,
                    cmap=DIVERGING_MAP,
                    vmin=-bound,
                    vmax=bound,
                )
                axes.set_aspect("equal")
                frameless(axes)
            above.set_title(title)
            above.set_xlabel("x, forward [m]")
            beside.set_xlabel("distance from swing axis [m]")
        panels[0, 0].set_ylabel("y, left [m]")
        panels[1, 0].set_ylabel("z, up [m]")
        figure.colorbar(marks, ax=panels, label="pitch [rad] (positive: tip outwards)", shrink=0.6, aspect=30)
        return to_png(figure)


def draw_sector(axes: Axes, workspace: WorkspaceSpecification) -> None:
    """Outline of W+ from above."""
    yaw = np.linspace(-workspace.yaw_max_rad, workspace.yaw_max_rad, ARC_POINTS)
    radius = np.repeat([workspace.radius_min_m, workspace.radius_max_m], ARC_POINTS)
    angle = np.concatenate([yaw, yaw[::-1]])
    outline = np.stack([radius * np.cos(angle), radius * np.sin(angle)])
    axes.plot(*np.append(outline, outline[:, :1], axis=1), color=REGION, linewidth=1.0)


def draw_section(axes: Axes, workspace: WorkspaceSpecification) -> None:
    """Outline of W+ in the plane of the arm."""
    near, far, low, high = (
        workspace.radius_min_m,
        workspace.radius_max_m,
        workspace.z_min_m,
        workspace.z_max_m,
    )
    axes.plot([near, far, far, near, near], [low, low, high, high, low], color=REGION, linewidth=1.0)
