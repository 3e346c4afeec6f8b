"""Figures of models and policies, from plain arrays to SVG."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.ticker import EngFormatter

from pipeline.reporting.style import (
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
DARK_CELL = 0.55  # success rates below are dark cells: their numbers are written in white


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


def error_growth_figure(
    dt_s: float,
    errors: Mapping[str, np.ndarray],
    joint_names: Sequence[str],
    units: Sequence[str],
) -> bytes:
    """How open-loop errors grow over the horizon, joint by joint.

    Args:
        dt_s: time step, s.
        errors: RMSE after 1, 2, ... H steps, rad (m), shape (H, n_joint) each, by model.
        joint_names: n_joint names.
        units: their units.

    Returns:
        SVG bytes.
    """
    n_joint = len(joint_names)
    with StyledFigure(WIDTH_IN, 2.6) as figure:
        panels = figure.subplots(1, n_joint, squeeze=False)[0]
        for j, (name, unit) in enumerate(zip(joint_names, units, strict=True)):
            for i, (model, error) in enumerate(errors.items()):
                t_s = dt_s * np.arange(1, len(error) + 1)
                panels[j].plot(t_s, error[:, j], label=model, **series_style(i))
            panels[j].set_title(f"{name} [{unit}]")
            panels[j].set_ylim(bottom=0.0)
            panels[j].set_xlim(left=0.0)
            panels[j].set_xlabel("horizon [s]")
        panels[0].set_ylabel("RMSE")
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
    with StyledFigure(0.42 * n_position + 2.0, (0.30 * n_pitch + 0.75) * len(rates)) as figure:
        panels = figure.subplots(len(rates), 1, squeeze=False, sharex=True)[:, 0]
        for axes, (policy, rate) in zip(panels, rates.items(), strict=True):
            picture = axes.imshow(
                rate.T, origin="lower", aspect="auto", cmap=SEQUENTIAL_MAP, vmin=0.0, vmax=1.0
            )
            for (i, j), value in np.ndenumerate(rate):
                colour = "white" if value < DARK_CELL else INK
                axes.text(i, j, f"{value:.2f}", ha="center", va="center", fontsize=6.5, color=colour)
            axes.set_title(policy)
            axes.set_yticks(
                range(n_pitch), [f"{threshold:.2f}" for threshold in pitch_thresholds_rad], fontsize=7
            )
            axes.set_ylabel("pitch error [rad]")
            axes.tick_params(length=0)
            frameless(axes)
        labels = [f"{threshold:.2f}" for threshold in position_thresholds_m]
        panels[-1].set_xticks(range(n_position), labels, fontsize=7)
        panels[-1].set_xlabel("position error [m]")
        figure.colorbar(picture, ax=panels, label="success rate", aspect=25)
        return to_svg(figure)


class LearningCurve(NamedTuple):
    """Returns over training for several seeds.

    Attributes:
        steps: environment steps, shape (n_point,).
        returns: average return, shape (n_seed, n_point).
    """

    steps: np.ndarray
    returns: np.ndarray


def learning_curve_figure(curves: Mapping[str, LearningCurve], label: str = "average return") -> bytes:
    """Learning curves: mean over seeds, band of one standard deviation, each seed as a thin line.

    Args:
        curves: by policy.
        label: of the vertical axis.

    Returns:
        SVG bytes.
    """
    with StyledFigure(WIDTH_IN, 3.2) as figure:
        axes = figure.subplots()
        for i, (policy, curve) in enumerate(curves.items()):
            style = series_style(i)
            mean, deviation = curve.returns.mean(axis=0), curve.returns.std(axis=0)
            axes.plot(curve.steps, curve.returns.T, color=style["color"], linewidth=0.5, alpha=0.5)
            axes.fill_between(
                curve.steps,
                mean - deviation,
                mean + deviation,
                color=style["color"],
                alpha=BAND_OPACITY,
                linewidth=0.0,
            )
            axes.plot(curve.steps, mean, label=f"{policy} (n = {len(curve.returns)})", linewidth=1.8, **style)
        axes.xaxis.set_major_formatter(EngFormatter(sep=" "))
        axes.set_xlabel("environment steps")
        axes.set_ylabel(label)
        axes.margins(x=0.01)
        axes.legend(loc="lower right")
        return to_svg(figure)
