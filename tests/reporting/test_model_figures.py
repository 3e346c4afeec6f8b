"""Figures of the judgement show what they are given, whatever was predicted."""

import io
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from PIL import Image

from pipeline.dynamics.evaluation.error_growth import ErrorGrowth
from pipeline.dynamics.judgement import OpenLoopPrediction
from pipeline.reporting.figures import models as model_figures
from pipeline.reporting.figures.models import error_growth_band_figure, open_loop_prediction_figure
from pipeline.reporting.figures.style import to_png

JOINTS, UNITS = ("lift", "tilt", "turn"), ("m", "rad", "rad")


def open_loop(command: float = 1.0, error: float = 0.1) -> bytes:
    t_s = 7.0 + np.arange(60) * 0.05
    q = np.stack([np.sin(t_s), np.cos(t_s), np.zeros(60)], axis=1)
    commands = np.full((60, 3), command)
    predictions = {
        name: OpenLoopPrediction("log", t_s, q, q + sign * error, commands)
        for name, sign in (("MLP", 1), ("KAN", -1))
    }
    return open_loop_prediction_figure(predictions, JOINTS, UNITS)


def growth(band: float = 0.1) -> bytes:
    rmse = np.sqrt(np.arange(1, 81))[:, None] * np.array([0.01, 0.02, 0.0])
    one = ErrorGrowth(rmse, rmse * (1 - band), rmse * (1 + band), n_windows=10, n_blocks=5)
    lost = ErrorGrowth(np.full((80, 3), 1e6), rmse * np.nan, rmse * np.nan, n_windows=10, n_blocks=5)
    return error_growth_band_figure({"MLP": one, "NARX": lost}, ["NARX"], 0.05, JOINTS, UNITS)


@pytest.mark.parametrize("draw", [open_loop, growth])
def test_figures_are_stable_svg(draw):
    first = draw()
    assert ElementTree.fromstring(first).tag.endswith("svg")
    assert draw() == first


def pixels(picture: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)


def share_of(picture: np.ndarray, colour: str) -> float:
    wanted = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    return float(np.mean(np.abs(picture - wanted).max(axis=-1) <= 2))


def test_bands_show_the_commands_sign(monkeypatch):
    monkeypatch.setattr(model_figures, "to_svg", to_png)
    positive, negative = (model_figures.COMMAND_BANDS[sign][0] for sign in (1, -1))
    forward, backward, none = (pixels(open_loop(command)) for command in (0.4, -1.0, 0.0))
    assert share_of(forward, positive) > 0.3 > 0.02 > share_of(forward, negative)
    assert share_of(backward, negative) > 0.3 > 0.02 > share_of(backward, positive)
    assert max(share_of(none, positive), share_of(none, negative)) < 0.02


@pytest.mark.parametrize("error", [1e6, np.nan, np.inf])
def test_a_diverged_prediction_leaves_the_measured_curve_visible(error, monkeypatch):
    monkeypatch.setattr(model_figures, "to_svg", to_png)
    ink = share_of(pixels(open_loop(0.0, error)), model_figures.MEASURED)
    assert ink > 0.5 * share_of(pixels(open_loop(0.0, 0.0)), model_figures.MEASURED)
