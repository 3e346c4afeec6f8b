import io
import xml.etree.ElementTree as ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image

from pipeline.machine.specification import WorkspaceSpecification
from pipeline.reporting.figures.arrays import (
    CurvePanel,
    SeedCurves,
    learning_curve_figure,
    open_loop_figure,
    success_rate_figure,
)
from pipeline.reporting.figures.workspace import Cloud, cloud_figure

JOINTS, UNITS = ("lift", "tilt"), ("m", "rad")
WORKSPACE = WorkspaceSpecification(0.9, 2.6, 0.85, 0.155, 2.5, 0.155)


def open_loop() -> bytes:
    t_s = np.arange(40) * 0.05
    q = np.stack([np.sin(t_s), np.cos(t_s)], axis=1)
    return open_loop_figure(t_s, q, np.sign(q), {"MLP": q + 0.1, "KAN": q - 0.1}, JOINTS, UNITS)


def success_rate() -> bytes:
    return success_rate_figure({"PPO": np.linspace(0, 1, 12).reshape(4, 3)}, np.arange(4), np.arange(3))


def learning_curve() -> bytes:
    steps = np.linspace(0, 1e6, 10)
    curves = {"PPO": SeedCurves(steps, np.stack([steps, 2 * steps]))}
    return learning_curve_figure([CurvePanel("return", None, curves)])


@pytest.mark.parametrize("draw", [open_loop, success_rate, learning_curve])
def test_figures_are_stable_svg_and_leave_no_settings_behind(draw):
    settings = dict(mpl.rcParams)
    first = draw()
    assert ElementTree.fromstring(first).tag.endswith("svg")
    assert draw() == first  # unchanged results leave unchanged files
    assert dict(mpl.rcParams) == settings


def test_matrix_of_another_shape_than_its_thresholds_is_refused():
    with pytest.raises(ValueError, match="shape"):
        success_rate_figure({"PPO": np.zeros((3, 4))}, np.arange(4), np.arange(3))


def cloud_pixels(y: float) -> np.ndarray:
    position = np.array([[1.3, y, 2.0]]) + np.random.default_rng(0).normal(0.0, 0.05, (4000, 3))
    picture = cloud_figure({"session": Cloud(position, np.full(4000, 0.8))}, WORKSPACE)
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)


def test_cloud_is_drawn_where_the_tip_was():
    """Left of the machine is up in the plan, and the side view does not tell left from right."""
    left, right = cloud_pixels(1.2), cloud_pixels(-1.2)
    assert np.array_equal(left, cloud_pixels(1.2))
    plan = slice(0, len(left) // 2)
    changed = np.abs(left - right).sum(axis=-1)[plan] > 100
    darker_left = left[plan].sum(axis=-1) < right[plan].sum(axis=-1)  # marks on white
    rows_left, rows_right = (np.nonzero(changed & mask)[0] for mask in (darker_left, ~darker_left))
    assert len(rows_left) > 100
    assert len(rows_right) > 100
    assert rows_left.mean() < rows_right.mean()
