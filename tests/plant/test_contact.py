"""The tip meets the ground and the machine's base."""

import numpy as np
import pytest

from pipeline.configuration.load import load_machine
from pipeline.machine.kinematics import load_arm
from pipeline.machine.specification import MACHINE_DIRECTORY
from pipeline.plant.machines.characterise import in_the_air
from pipeline.plant.physics.kinematics import tip
from pipeline.plant.simulator import Plant
from pipeline.plant.state import FRICTION, PISTON, STOP
from pipeline.reaching.metrics import reaching_metrics
from tests.reaching.test_metrics import traces

from .conftest import MIDDLE, random_commands
from .test_balances import mechanical_energy

TOLERANCE_M = 0.002  # play of the joints, 0.6 mrad, over an arm of 2.5 m, and the penetration of one substep
LOWER_BOOM = np.tile([0, -1, 0, 0], (80, 1))
FOLDED = np.array([0.0, 0.0, -2.38, -0.92])  # the tip in front of the base, low; the boom takes it inwards


def test_the_ground_stops_the_tip_and_the_meeting_is_counted_once(nominal):
    plant, falling = Plant(nominal, 0, MIDDLE), Plant(in_the_air(nominal), 0, MIDDLE)
    z = tip(plant.run(LOWER_BOOM).angle_rad)[0][:, 1]
    assert tip(falling.run(LOWER_BOOM).angle_rad)[0][-1, 1] < -0.1
    assert np.abs(z[-20:]).max() < TOLERANCE_M  # it rests there under the command
    assert plant.state.contacts[0] == 1 and falling.state.contacts[0] == 0
    plant.run(np.tile([0, 1, 0, 0], (40, 1)))
    assert tip(plant.state.link_angle_rad)[0][1] > 0.1  # the ground does not hold it
    plant.run(LOWER_BOOM)
    assert plant.state.contacts[0] == 2


def test_the_base_stops_the_tip(nominal):
    plant, through = Plant(nominal, 0, FOLDED), Plant(in_the_air(nominal), 0, FOLDED)
    radius, base = tip(plant.run(LOWER_BOOM).angle_rad)[0][:, 0], nominal.contact.base_radius_m
    assert tip(through.run(LOWER_BOOM).angle_rad)[0][:, 0].min() < base - 0.02
    assert radius.min() > base - TOLERANCE_M
    assert plant.state.contacts[0] >= 1


@pytest.mark.parametrize("start", [MIDDLE, FOLDED])
def test_the_environment_s_metric_counts_what_the_plant_stops(nominal, start):
    """And both have the surfaces of the robot description."""
    arm = load_arm(load_machine("bobcat_e10"), MACHINE_DIRECTORY)
    assert arm.surfaces == (0.0, nominal.contact.base_radius_m, nominal.contact.base_height_m)
    for command, contacts in ((LOWER_BOOM, 1), (-LOWER_BOOM, 0)):
        plant = Plant(nominal, 0, start)
        position = arm.forward(plant.run(command).angle_rad).position
        still = np.zeros((1, len(position)))
        made_up = traces(still, still, x=position[:, 0], z=position[:, 2])
        met = reaching_metrics(made_up, arm.surfaces).ground
        assert met == contacts == min(plant.state.contacts[0], 1)


def test_a_motion_that_never_touches_is_as_in_the_air(nominal):
    commands = random_commands(2, 12, 15)
    commands[:, 1:] = np.abs(commands[:, 1:])  # up and out
    with_ground, without = Plant(nominal, 5, MIDDLE), Plant(in_the_air(nominal), 5, MIDDLE)
    one, other = with_ground.run(commands), without.run(commands)
    assert with_ground.state.contacts[0] == 0
    np.testing.assert_array_equal(one.angle_rad, other.angle_rad)
    np.testing.assert_array_equal(one.joint_states.position_rad, other.joint_states.position_rad)


def test_the_ground_makes_no_energy(nominal):
    """What the pistons give goes into the load's energy, friction, and the ground, which only takes."""
    plant = Plant(nominal, 0, MIDDLE)
    plant.run(np.zeros((20, 4)))
    before, account = mechanical_energy(nominal, plant), plant.state.energy_J.copy()
    plant.run(LOWER_BOOM)
    piston, friction, stop = (plant.state.energy_J - account)[[PISTON, FRICTION, STOP]]
    assert plant.state.contacts[0] == 1 and stop > 0.0
    gained = mechanical_energy(nominal, plant) - before
    assert abs(piston - friction - stop - gained) < 0.02 * (abs(piston) + friction)
