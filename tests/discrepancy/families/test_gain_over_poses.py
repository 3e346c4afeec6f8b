"""A gain that varies with the joint's place against a change that begins somewhere."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.discrepancy.families.gain_over_poses import is_a_gain_over_poses
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.effects.dependence import DEPENDENCES, N_DIRECTION
from pipeline.effects.effect import Setting, Signals
from tests.discrepancy.bare_candidate import bare_candidate

SETTING = Setting(0.05, np.full(2, -1.0), np.full(2, 1.0), np.full(2, 0.5))
N_ROWS = 400
BOTH = ((("ratio_positive", None), ("ratio_negative", None)),)
UP_ALONE = ((("ratio_positive", None),),)


def gain(freed=BOTH) -> Candidate:
    return Candidate("gain", 0, None, {}, freed, np.array([-0.2] * len(freed)), 1.0, 0.5, np.ones(1))


def on_place(loss: dict[float, float], source: int = 0, ways=range(N_DIRECTION)) -> Candidate:
    """Losses of joint 0 at some knots of the place of joint `source`."""
    knots = DEPENDENCES["other:position"].knots
    where = {
        basis: change
        for basis, at in enumerate(knots)
        for place, change in loss.items()
        if np.isclose(at, place)
    }
    freed = tuple((("coefficients", (way, source, basis)),) for way in ways for basis in where)
    coefficients = np.array([-change for _ in ways for change in where.values()])
    return Candidate("other:position", 0, source, {}, freed, coefficients, 1.0, 0.6, np.ones(1))


def judge(dependence: Candidate, name: Candidate, places: np.ndarray) -> bool:
    """Of logs in which joint 0 goes both ways at `places`, which joint 1 is at, too."""
    effect = DEPENDENCES["other:position"](SETTING)
    u = np.where(np.arange(N_ROWS) % 2, 0.4, -0.4)[None, :, None] * np.ones(2)
    q = np.resize(places, N_ROWS)[None, :, None] * np.ones(2)
    signals = Signals(np.sign(u), q, np.zeros(u.shape[:-1]))

    def velocities(hypotheses):
        return np.stack(
            [
                u
                * np.asarray(
                    effect.ratio(h.values.get("other:position", effect.neutral()), (), u, signals)[1]
                )
                for h in hypotheses
            ]
        )

    simulation = SimpleNamespace(effects={"other:position": effect}, velocities=velocities, setting=SETTING)
    rows = SimpleNamespace(is_used=np.ones((1, N_ROWS), bool))
    return is_a_gain_over_poses(simulation, rows, [], dependence, name)


ABOVE = np.linspace(1 / 3, 1.0, 50)
ALL_OVER = np.linspace(-1.0, 1.0, 50)
EVERYWHERE = {1 / 3: 0.15, 2 / 3: 0.2, 1.0: 0.3}


def test_what_is_less_here_and_more_there_but_never_gone_is_a_gain() -> None:
    assert judge(on_place(EVERYWHERE), gain(), ABOVE)


def test_what_is_not_there_on_part_of_the_range_is_none() -> None:
    assert not judge(on_place(EVERYWHERE), gain(), ALL_OVER)
    assert not judge(on_place({1.0: 0.3}), gain(), ABOVE)


def test_a_gain_of_one_way_needs_but_that_way() -> None:
    up = on_place(EVERYWHERE, ways=[1])
    assert judge(up, gain(UP_ALONE), ABOVE)
    assert not judge(up, gain(), ABOVE)


@pytest.mark.parametrize(
    ("dependence", "name"),
    [
        (on_place(EVERYWHERE, source=1), gain()),
        (on_place(EVERYWHERE), bare_candidate("lag", 0, added_time_constant=0.1)),
        (bare_candidate("other:hold_time", 0), gain()),
    ],
)
def test_only_a_joints_own_place_is_told_as_its_gain(dependence: Candidate, name: Candidate) -> None:
    assert not judge(dependence, name, ABOVE)
