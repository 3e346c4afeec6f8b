"""Backlash against the play operator as textbooks have it."""

import numpy as np
import pytest

from pipeline.effects.backlash import Backlash

from .conftest import DT_S, SETTING, respond, rows

pytestmark = pytest.mark.usefixtures("float64")

WIDTH = np.array([0.03, 0.008])


def play(drive: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Link positions of drive positions: the link stays until a flank takes it along. It begins in the middle."""
    link, links = drive[0].copy(), []
    for position in drive:
        link = np.clip(link, position - width / 2, position + width / 2)
        links.append(link)
    return np.array(links)


def test_the_link_follows_as_a_play_operator():
    u = rows(3, 200)[0].astype(float)
    drive = np.concatenate([np.zeros((1, 2)), np.cumsum(DT_S * u, axis=0)])
    v = respond(Backlash(SETTING), {"width": WIDTH}, u)
    np.testing.assert_allclose(DT_S * np.cumsum(v, axis=0), play(drive, WIDTH)[1:], atol=1e-12)


def test_each_reversal_costs_the_width_and_repeated_starts_cost_nothing():
    there, back, rest = np.full((20, 2), 0.1), np.full((20, 2), -0.1), np.zeros((5, 2))
    v = respond(Backlash(SETTING), {"width": WIDTH}, np.concatenate([there, rest, there, back]))
    way = DT_S * np.array([part.sum(axis=0) for part in np.split(v, [20, 25, 45])])
    np.testing.assert_allclose(way, [0.1 - WIDTH / 2, [0, 0], [0.1, 0.1], -0.1 + WIDTH], atol=1e-12)


def test_measured_motion_tells_on_which_flank_the_drive_lies():
    effect = Backlash(SETTING)
    half = WIDTH / 2
    for v, gap in [((0.3, 0.06), half), ((-0.3, -0.06), -half), ((0.01, -0.001), (0.01, 0.002))]:
        state, u = effect.invert({"width": WIDTH}, np.array([0.01, 0.002]), np.array(v), None)
        np.testing.assert_array_equal(u, v)
        np.testing.assert_allclose(state, gap)
