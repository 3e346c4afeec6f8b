"""A speed that varies without an equation is followed, on logs of a simulated machine."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.discrepancy.correction.corrected_models import CorrectedModels, held_out_errors
from pipeline.discrepancy.correction.follow_speed import filters_of
from pipeline.discrepancy.diagnosis.splits import Purpose
from pipeline.discrepancy.selection.grouping import MachineEffect
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.effects.varying_speed import FAMILY
from tests.discrepancy.bare_candidate import bare_candidate
from tests.effects.conftest import DT_S, SETTING
from tests.effects.linear_machine import linear_model, simulated

NOISE = np.array([1e-3, 3e-4])


def effect(family, *joints):
    name = "other" if family.startswith("other") else family
    return MachineEffect(name, [SelectedEffect(bare_candidate(family, joint, width=3.0)) for joint in joints])


def to_and_fro(n_rows):
    """Holds of each joint and the same back, so that no stop is reached."""
    random = np.random.default_rng(7)
    a = np.zeros((n_rows, 2))
    for joint in range(2):
        row = 10
        while row < n_rows - 40:
            steps, direction = random.integers(5, 15), random.choice([-1.0, 1.0])
            a[row : row + steps, joint], a[row + steps : row + 2 * steps, joint] = direction, -direction
            row += 2 * steps + random.integers(0, 5)
    return a


def followed(course, effects):
    """The corrected models after their fit, and errors on rows that it did not see without and with them."""
    log = simulated(to_and_fro(1500), on_velocity=lambda t, u, v, a, q: course(t) * u)
    purpose = np.repeat([Purpose.fit, Purpose.select, Purpose.confirm], 500)
    logs = SimpleNamespace(measured=[log], purposes=[purpose])
    models = CorrectedModels(*linear_model("dqdot"), SimpleNamespace(setting=SETTING))
    models.follow(logs, effects, NOISE)
    return models, *(held_out_errors(logs, models.with_effects(of), 80).rmse for of in ([], effects))


def wave(t):
    return 0.3 * np.sin(2.0 * np.pi * DT_S * t / 40.0)


def test_a_supply_is_followed_on_all_its_joints():
    effects = [effect("supply_variation", 0, 1)]
    models, before, after = followed(lambda t: 1.0 + wave(t), effects)
    assert np.all(after < 0.6 * before)
    values = models.active(effects).values[FAMILY]
    assert np.all(values["common_std"] > 0.0)
    assert np.all(values["own_std"] == 0.0)


def test_a_course_of_one_joint_is_followed_there_alone():
    effects = [effect("other:absolute_time", 1)]
    _, before, after = followed(lambda t: 1.0 + np.array([0.0, wave(t)]), effects)
    assert after[0] == pytest.approx(before[0], abs=1e-7)
    assert after[1] < 0.6 * before[1]


def test_nothing_is_followed_where_that_would_be_no_better():
    effects = [effect("supply_variation", 0, 1)]
    models, before, after = followed(lambda t: 1.0, effects)
    assert models.active(effects) is None or np.all(after <= before + 1e-7)


def test_effects_with_an_equation_are_not_followed():
    assert filters_of([effect("gain", 0)], NOISE) == []
