"""Figures of models and policies, from plain arrays to SVG."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import EngFormatter

from pipeline.reporting.figures.style import (
    INK,
    MEASURED,
    REGION,
    SEQUENTIAL_MAP,
    StyledFigure,
    frameless,
    series_style,
    to_svg,
)

WIDTH_IN = 8.0
JOINT_HEIGHT_IN, COMMAND_RATIO = 1.45, 0.28  # a joint's panel, and its commands' panel relative to it
BAND_OPACITY = 0.18
MATRIX_COLUMNS = 2
MATRIX_CELL_IN = (0.27, 0.22)
DARK_CELL = 0.55  # below this success rate, numbers are white on dark cells


def open_loop_figure(
    t_s: np.ndarray,
    measured: np.ndarray,
    commands: np.ndarray,
    predicted: Mapping[str, np.ndarray],
    joint_names: Sequence[str],
    units: Sequence[str],
) -> bytes:
    """Measured positions beside open-loop predictions, joint by joint (paper, figure "Open-loop ...").

    Args:
        t_s: time, s, shape (T,).
        measured: rad (m), shape (T, n_joint).
        commands: in [-1, 1], shape (T, n_joint), drawn as a strip below each joint.
        predicted: rad (m), shape (T, n_joint) each, by model.
        joint_names: n_joint names.
        units: their units.

    Returns:
        SVG bytes.
    """
    n_joint = len(joint_names)
    with StyledFigure(WIDTH_IN, JOINT_HEIGHT_IN * (1.0 + COMMAND_RATIO) * n_joint + 0.5) as figure:
        panels = figure.subplots(2 * n_joint, 1, sharex=True, height_ratios=[1.0, COMMAND_RATIO] * n_joint)
        for j, (name, unit) in enumerate(zip(joint_names, units, strict=True)):
            position, command = panels[2 * j], panels[2 * j + 1]
            position.plot(t_s, measured[:, j], color=MEASURED, linewidth=1.6, label="measured")
            for i, (model, q) in enumerate(predicted.items()):
                position.plot(t_s, q[:, j], label=model, **series_style(i))
            position.set_title(name)
            position.set_ylabel(f"[{unit}]")
            command.fill_between(t_s, commands[:, j], step="post", color=REGION, linewidth=0.0)
            command.set_ylim(-1.2, 1.2)
            command.set_yticks([-1, 0, 1], ["-1", "0", "1"], fontsize=6.5)
            command.set_ylabel("cmd.", fontsize=7.0)
            command.grid(False)
        panels[0].set_xlim(t_s[0], t_s[-1])
        panels[-1].set_xlabel("time [s]")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper right", ncols=len(labels))
        return to_svg(figure)


def success_rate_figure(
    rates: Mapping[str, np.ndarray],
    position_thresholds_m: np.ndarray,
    pitch_thresholds_rad: np.ndarray,
) -> bytes:
    """Success rate matrices (paper, figure "Success rate matrices").

    Args:
        rates: success rates in [0, 1], shape (n_position, n_pitch) each, by policy.
        position_thresholds_m: shape (n_position,).
        pitch_thresholds_rad: shape (n_pitch,).

    Returns:
        SVG bytes.

    Raises:
        ValueError: a matrix has another shape than the thresholds.
    """
    n_position, n_pitch = len(position_thresholds_m), len(pitch_thresholds_rad)
    for policy, rate in rates.items():
        if rate.shape != (n_position, n_pitch):
            raise ValueError(f"rates of {policy} have shape {rate.shape}, expected {(n_position, n_pitch)}")
    columns = min(len(rates), MATRIX_COLUMNS)
    rows = -(-len(rates) // columns)
    width, height = MATRIX_CELL_IN[0] * n_position + 0.5, MATRIX_CELL_IN[1] * n_pitch + 0.5
    with StyledFigure(width * columns + 0.8, height * rows + 0.4) as figure:
        panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        for axes, (policy, rate) in zip(panels.flat, rates.items(), strict=False):
            picture = axes.imshow(
                rate.T, origin="lower", aspect="auto", cmap=SEQUENTIAL_MAP, vmin=0.0, vmax=1.0
            )
            for (i, j), value in np.ndenumerate(rate):
                colour = "white" if value < DARK_CELL else INK
                axes.text(i, j, f"{100 * value:.0f}", ha="center", va="center", fontsize=6.5, color=colour)
            axes.set_title(policy)
            axes.tick_params(length=0, labelsize=7, labelbottom=True)
            axes.tick_params(axis="x", labelrotation=90)
            frameless(axes)
        for empty in panels.flat[len(rates) :]:
            empty.set_visible(False)
        panels[0, 0].set_xticks(range(n_position), [f"{m:.2f}" for m in position_thresholds_m])
        panels[0, 0].set_yticks(range(n_pitch), [f"{rad:.2f}" for rad in pitch_thresholds_rad])
        figure.supxlabel("distance below [m]", fontsize=9.0)
        figure.supylabel("pitch error below [rad]", fontsize=9.0)
        bar = figure.colorbar(picture, ax=panels, label="success rate [%]", aspect=30, pad=0.01)
        bar.set_ticks([0.0, 0.25, 0.5, 0.75, 1.0], labels=["0", "25", "50", "75", "100"])
        return to_svg(figure)


class SeedCurves(NamedTuple):
    """A quantity over training for several seeds.

    Attributes:
        steps: environment steps, shape (n_point,).
        values: shape (n_seed, n_point).
    """

    steps: np.ndarray
    values: np.ndarray


class CurvePanel(NamedTuple):
    """A panel of learning curves.

    Attributes:
        label: of the vertical axis.
        limits: of the vertical axis, or None for those of the data.
        curves: by policy.
    """

    label: str
    limits: tuple[float, float] | None
    curves: Mapping[str, SeedCurves]


def learning_curve_figure(quantities: Sequence[CurvePanel]) -> bytes:
    """Learning curves: mean over seeds, band of one standard deviation, each seed as a thin line.

    Args:
        quantities: of the same policies, a panel each.

    Returns:
        SVG bytes.
    """
    with StyledFigure(WIDTH_IN, 3.2) as figure:
        panels = figure.subplots(1, len(quantities), squeeze=False)[0]
        for axes, panel in zip(panels, quantities, strict=True):
            for i, (policy, curve) in enumerate(panel.curves.items()):
                _draw_learning_curve(axes, curve, series_style(i), policy)
            axes.xaxis.set_major_formatter(EngFormatter(sep=" "))
            axes.set_xlabel("environment steps")
            axes.set_ylabel(panel.label)
            axes.margins(x=0.01)
            axes.set_ylim(panel.limits)
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper right", ncols=2)
        return to_svg(figure)


def _draw_learning_curve(axes: Axes, curve: SeedCurves, style: dict[str, Any], policy: str) -> None:
    seeds = f"{len(curve.values)} seed{'s' if len(curve.values) > 1 else ''}"
    mean = curve.values.mean(axis=0)
    if len(curve.values) > 1:
        deviation = curve.values.std(axis=0, ddof=1)
        band = (mean - deviation, mean + deviation)
        axes.fill_between(curve.steps, *band, color=style["color"], alpha=BAND_OPACITY, linewidth=0.0)
        axes.plot(curve.steps, curve.values.T, color=style["color"], linewidth=0.5, alpha=0.5)
    axes.plot(curve.steps, mean, label=f"{policy} ({seeds})", linewidth=1.8, **style)
