"""A model for those who take the network alone: effects around it are not passed over."""

import dataclasses
from pathlib import Path

import jax
import numpy as np
import pytest

from pipeline.dynamics.model.store import save_model
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.store import ActiveEffects, save_effects
from pipeline.effects.unaugmented_model import load_plain_model_of
from pipeline.errors import InputError
from pipeline.machine.specification import JointSpecification, MachineSpecification
from tests.effects.conftest import SETTING, VALUES, make_model

SPECIFICATION = make_model().specification
MACHINE = MachineSpecification(
    "mine",
    SPECIFICATION.rate_hz,
    [
        JointSpecification(*joint)
        for joint in zip(
            SPECIFICATION.joints, SPECIFICATION.position_lower, SPECIFICATION.position_upper, strict=True
        )
    ],
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    model = make_model()
    save_model(tmp_path, model, model.initialise(jax.random.key(0)), {}, {}, {})
    return tmp_path


def test_a_model_without_effects_is_taken(folder: Path) -> None:
    expected = make_model().initialise(jax.random.key(0))
    jax.tree.map(np.testing.assert_array_equal, load_plain_model_of(folder, MACHINE)[1], expected)
    save_effects(folder, ActiveEffects(SETTING, {"gain": KNOWN["gain"](SETTING).neutral()}, {}))
    jax.tree.map(np.testing.assert_array_equal, load_plain_model_of(folder, MACHINE)[1], expected)


def test_effects_are_not_passed_over(folder: Path) -> None:
    save_effects(folder, ActiveEffects(SETTING, {"lag": VALUES["lag"]}, {}))
    with pytest.raises(InputError, match=r"effects\.json: the model has effects around it \(lag\)"):
        load_plain_model_of(folder, MACHINE)


def test_a_machine_is_not_known_by_its_joints_names_alone(folder: Path) -> None:
    first, *others = MACHINE.joints

    def wider(share: float) -> MachineSpecification:
        upper = first.upper + share * (first.upper - first.lower)
        return dataclasses.replace(MACHINE, joints=[dataclasses.replace(first, upper=upper), *others])

    load_plain_model_of(folder, wider(0.05))  # a limit that was corrected
    with pytest.raises(InputError, match="give the model's machine=NAME, or identify again"):
        load_plain_model_of(folder, wider(0.2))
