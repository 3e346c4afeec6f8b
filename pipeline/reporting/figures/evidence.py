"""Evidence of a change from session to session, and the course of what has changed."""

from typing import Any

import numpy as np

from pipeline.reporting.figures.style import INK, REGION, SERIES, StyledFigure, series_style, to_svg

WIDTH_IN, HEIGHT_IN = 4.6, 2.5  # text is readable on a telephone, and two stand side by side on a screen
LARGEST = 1e12  # more evidence is drawn as this


def evidence_figure(document: dict[str, Any]) -> bytes:
    """Evidence per joint over the sessions of `watch.json`, with the alarm line, as SVG."""
    sessions = document["sessions"]
    index = np.arange(1, len(sessions) + 1)
    with StyledFigure(WIDTH_IN, HEIGHT_IN) as figure:
        axes = figure.subplots()
        for number, joint in enumerate(sessions[0]["joints"]):
            values = [min(of["joints"][joint]["e_value"], LARGEST) for of in sessions]
            axes.plot(index, values, label=joint, **series_style(number))
        whole = [min(of["e_value"], LARGEST) for of in sessions]
        axes.plot(index, whole, color=INK, linewidth=2.0, label="machine")
        axes.axhline(document["alarm_at"], color=SERIES[1], linewidth=1.0)
        axes.annotate(
            "alarm", (index[0], document["alarm_at"]), xytext=(0, 2), textcoords="offset points", fontsize=8
        )
        for finding in document["findings"]:
            _shade(axes, finding, [of["name"] for of in sessions])
        axes.set(yscale="log", xlabel="session", ylabel="evidence (e-value)", ylim=(1e-2, None))
        axes.legend(fontsize=8, ncols=2)
        return to_svg(figure)


def course_figure(finding: dict[str, Any]) -> bytes:
    """The statistic that shows a change most, from its first session on, beside its range before, as SVG."""
    size = finding["size"]
    values = np.array(size["by_session"], float)
    index = np.arange(1, len(values) + 1)
    with StyledFigure(WIDTH_IN, HEIGHT_IN) as figure:
        axes = figure.subplots()
        low, high = (size["before"] + sign * 2.0 * size["deviation"] for sign in (-1, 1))
        axes.axhspan(low, high, color=REGION, alpha=0.25, linewidth=0)
        axes.plot(index, values, "o-", color=SERIES[0], markersize=3.5)
        trend = finding["trend"]
        if trend is not None:
            line = size["before"] + trend["latest"] + trend["per_session"] * (index - index[-1])
            axes.plot(index, line, "--", color=SERIES[1])
        unit = "" if size["unit"] == "1" else f" [{size['unit']}]"
        name = size["statistic"].replace("_", " ")
        axes.locator_params(axis="x", integer=True)
        axes.set(xlabel="session since the change", ylabel=f"{size['joint']}: {name}{unit}")
        return to_svg(figure)


def _shade(axes: Any, finding: dict[str, Any], names: list[str]) -> None:
    begin = names.index(finding["onset"]["session"]) + 1
    end = len(names) + 0.5 if finding["until"] is None else names.index(finding["until"]) + 0.5
    axes.axvspan(begin - 0.5, end, color=SERIES[1], alpha=0.12, linewidth=0)
