"""Figures of a model's judgement: long open-loop predictions, and how errors grow over the horizon."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from pipeline.dynamics.evaluation.error_growth import ErrorGrowth
from pipeline.dynamics.judgement import OpenLoopPrediction
from pipeline.reporting.figures.style import MEASURED, SERIES, SERIES_DASHES, StyledFigure, to_svg

WIDTH_IN = 8.0
JOINT_HEIGHT_IN = 1.5
GROWTH_ROW_HEIGHT_IN, GROWTH_COLUMNS = 2.7, 2
GROWTH_POINTS = 150  # drawn horizons, evenly spaced on the logarithmic axis
COMMAND_BANDS = {1: ("#fbd9b5", "command > 0"), -1: ("#cfe3f5", "command < 0")}  # pale, behind the curves
BAND_OPACITY = 0.15
REACH = 0.6  # of the measured span, above and below; predictions beyond are clipped
MARGIN = 0.05  # of the axis span, left free above and below
LEGEND_COLUMNS = 4


def open_loop_prediction_figure(
    predictions: Mapping[str, OpenLoopPrediction], joint_names: Sequence[str], units: Sequence[str]
) -> bytes:
    """Long open-loop predictions beside measurements, joint by joint (paper, Fig. "Open-loop predictions").

    The measured position is a solid line, predictions are dashed; behind them a band shows the command's sign.

    Args:
        predictions: Predictions by model, all of the same rows.
        joint_names: n_joint names.
        units: Their units.

    Returns:
        SVG bytes.
    """
    first = next(iter(predictions.values()))
    n_joint = len(joint_names)
    t_s = first.t_s - first.t_s[0]
    with StyledFigure(WIDTH_IN, JOINT_HEIGHT_IN * n_joint + 0.7) as figure:
        panels = figure.subplots(n_joint, 1, sharex=True, squeeze=False)[:, 0]
        for j, (name, unit) in enumerate(zip(joint_names, units, strict=True)):
            _draw_command_bands(panels[j], t_s, first.commands[:, j])
            panels[j].plot(t_s, first.measured[:, j], color=MEASURED, linewidth=1.7, label="measured")
            for i, (model, prediction) in enumerate(predictions.items()):
                panels[j].plot(t_s, prediction.predicted[:, j], label=model, **_dashed(i))
            panels[j].set_ylim(
                *_shown_range(first.measured[:, j], [p.predicted[:, j] for p in predictions.values()])
            )
            panels[j].set_title(name)
            panels[j].set_ylabel(f"position [{unit}]")
            panels[j].grid(axis="x", visible=False)
        panels[0].set_xlim(t_s[0], t_s[-1])
        panels[-1].set_xlabel("time since the last measurement that the model saw [s]")
        handles, _ = panels[0].get_legend_handles_labels()
        handles += [Patch(color=colour, label=label) for colour, label in COMMAND_BANDS.values()]
        figure.legend(handles=handles, loc="outside upper center", ncols=LEGEND_COLUMNS)
        return to_svg(figure)


def error_growth_band_figure(
    growth: Mapping[str, ErrorGrowth],
    references: Sequence[str],
    dt_s: float,
    joint_names: Sequence[str],
    units: Sequence[str],
) -> bytes:
    """Error over the horizon with bootstrap bands, joint by joint; both axes logarithmic.

    Args:
        growth: Errors by predictor, models and references.
        references: Names of the references; they are dashed.
        dt_s: Time step.
        joint_names: n_joint names.
        units: Their units.

    Returns:
        SVG bytes.
    """
    n_rows = -(-len(joint_names) // GROWTH_COLUMNS)
    with StyledFigure(WIDTH_IN, GROWTH_ROW_HEIGHT_IN * n_rows + 0.4) as figure:
        panels = figure.subplots(n_rows, GROWTH_COLUMNS, sharex=True, squeeze=False).ravel()
        for j, (name, unit) in enumerate(zip(joint_names, units, strict=True)):
            largest, smallest = 0.0, np.inf
            for i, (predictor, one) in enumerate(growth.items()):
                shown = np.unique(np.geomspace(1, len(one.rmse), GROWTH_POINTS).astype(int)) - 1
                t_s, colour = dt_s * (shown + 1), SERIES[i % len(SERIES)]
                dashes = SERIES_DASHES[1:][i % (len(SERIES_DASHES) - 1)] if predictor in references else "-"
                panels[j].fill_between(
                    t_s,
                    one.lower[shown, j],
                    one.upper[shown, j],
                    color=colour,
                    alpha=BAND_OPACITY,
                    linewidth=0.0,
                )
                panels[j].plot(t_s, one.rmse[shown, j], color=colour, linestyle=dashes, label=predictor)
                smallest = min(smallest, float(one.rmse[0, j]))
                if predictor not in references:
                    largest = max(largest, float(one.rmse[:, j].max()))
            panels[j].set_xscale("log")
            panels[j].set_yscale("log")
            panels[j].xaxis.set_major_formatter("{x:g}")
            panels[j].yaxis.set_major_formatter("{x:g}")
            panels[j].set_ylim(_below(smallest), _above(largest))
            panels[j].set_title(f"{name} [{unit}]")
        for panel in panels[len(joint_names) :]:
            panel.set_visible(False)
        for panel in panels[-GROWTH_COLUMNS:]:
            panel.set_xlabel("horizon [s]")
        figure.supylabel("root mean square error", fontsize=9.0)
        panels[0].set_xlim(dt_s, dt_s * max(len(one.rmse) for one in growth.values()))
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=LEGEND_COLUMNS)
        return to_svg(figure)


def _draw_command_bands(axes: Axes, t_s: np.ndarray, commands: np.ndarray) -> None:
    for sign, (colour, _) in COMMAND_BANDS.items():
        axes.fill_between(
            t_s,
            0.0,
            1.0,
            where=list(np.sign(commands) == sign),
            step="post",
            transform=axes.get_xaxis_transform(),
            color=colour,
            linewidth=0.0,
            zorder=0.5,
        )


def _shown_range(measured: np.ndarray, predicted: Sequence[np.ndarray]) -> tuple[float, float]:
    low, high = float(measured.min()), float(measured.max())
    reach = REACH * (high - low) or 1.0
    values = np.clip(
        np.nan_to_num(np.concatenate([measured, *predicted]), nan=low), low - reach, high + reach
    )
    low, high = float(values.min()), float(values.max())
    margin = MARGIN * (high - low) or 1.0
    return low - margin, high + margin


def _dashed(index: int) -> dict[str, object]:
    dashes = SERIES_DASHES[1:]  # measurements are solid
    return {"color": SERIES[index % len(SERIES)], "linestyle": dashes[index % len(dashes)]}


def _below(value: float) -> float:
    return 0.7 * value if value > 0 else 1e-6


def _above(value: float) -> float:
    return 10.0 * value if value > 0 else 1.0
