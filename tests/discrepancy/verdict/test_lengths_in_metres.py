"""Play of a millimetre in a cylinder with a stroke of ten centimetres, beside a joint in radians."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.scored_rows import rows_in_blocks
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Hypothesis
from pipeline.discrepancy.selection.screen import screen
from pipeline.effects.backlash import Backlash
from pipeline.effects.effect import Setting
from pipeline.effects.gain import Gain
from pipeline.effects.sensor_bias import SensorBias

N_ROWS, DT_S, BLOCK_ROWS = 2000, 0.05, 100
LOWER, UPPER, SPEED = np.array([0.01, -0.9]), np.array([0.11, 0.9]), np.array([0.02, 0.4])  # m, rad
SETTING = Setting(DT_S, LOWER, UPPER, SPEED)


def played(u: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Velocity of the links behind drives with velocity u (T, 2), by the links' positions."""
    drive = DT_S * np.cumsum(u, axis=0)
    link, links = np.zeros(2), []
    for place in drive:
        link = np.clip(link, place - 0.5 * width, place + 0.5 * width)
        links.append(link)
    return np.diff(np.array(links), axis=0, prepend=0.0) / DT_S


@pytest.mark.parametrize(("joint", "width"), [(0, 0.001), (0, 0.004), (1, 0.03)])
def test_play_is_found_in_proportion_to_the_range(joint: int, width: float) -> None:
    random = np.random.default_rng(1)
    u = SPEED * random.choice([-1.0, 0.0, 1.0], (N_ROWS // 20, 2)).repeat(20, axis=0)
    present = np.where(np.arange(2) == joint, width, 0.0)

    def velocities(hypotheses: list[Hypothesis], _: Any = None) -> np.ndarray:
        widths = [h.values["backlash"]["width"] if h.values else np.zeros(2) for h in hypotheses]
        return np.stack([played(u, of)[None] for of in widths])

    sequences = SimpleNamespace(velocity=played(u, present)[None])
    simulation: Any = SimpleNamespace(
        effects={"backlash": Backlash(SETTING)},
        setting=SETTING,
        sequences=sequences,
        velocities=velocities,
        nominal_velocities=lambda _: u[None, :, None],
    )
    is_used = np.ones((1, N_ROWS), bool)
    fold = np.arange(N_ROWS)[None] // BLOCK_ROWS % 2
    rows = rows_in_blocks(is_used, fold, np.ones((1, N_ROWS, 2), bool), np.ones(2), BLOCK_ROWS)
    (found,) = (c for c in screen(simulation, NOMINAL, rows) if c.joint == joint)
    assert found.share > 0.9
    assert found.point["width"] == pytest.approx(width, rel=0.3)


def test_only_lengths_of_joints_with_a_small_range_are_smaller() -> None:
    np.testing.assert_allclose(Backlash(SETTING).sizes("width"), [0.1 / 1.5, 1.0])
    np.testing.assert_allclose(SensorBias(SETTING).sizes("offset"), [0.1 / 1.5, 1.0])
    np.testing.assert_array_equal(SensorBias(SETTING).sizes("scale"), 1.0)
    np.testing.assert_array_equal(Gain(SETTING).sizes("ratio_positive"), 1.0)
