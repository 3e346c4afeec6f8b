"""`other`: pilot oil leaks between two lines, so one joint is faster only while another moves one way."""

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity, added, choose_direction
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES, N_JOINT
from pipeline.plant.machines.characterise import full_speed, side
from pipeline.plant.parameters import Parameters

SMALLEST, LARGEST = 0.14, 0.25  # share of the source's pilot pressure, below what opens a spool by itself


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """One pilot line of one joint leaks into one line of another."""
    joint, source = (int(j) for j in random.choice(N_JOINT, 2, replace=False))
    direction, source_direction = choose_direction(random), choose_direction(random)
    share = size * random.uniform(SMALLEST, LARGEST)
    index = (joint, side(direction), source, side(source_direction))

    def apply(parameters: Parameters) -> Parameters:
        return parameters.change("pilot", crosstalk=added(parameters.pilot.crosstalk, index, share))

    others = np.zeros(N_JOINT)
    others[source] = source_direction
    ratio = full_speed(apply(nominal), joint, direction, others) / full_speed(
        nominal, joint, direction, others
    )
    truth = {
        "speed_ratio_while_source_moves": Quantity(ratio, "1"),
        "direction": Quantity(direction, "sign"),
        "source_direction": Quantity(source_direction, "sign"),
    }
    depends_on = (f"command:{JOINT_NAMES[source]}",)
    return PlantEffect(
        "other", "pilot_crosstalk", (JOINT_NAMES[joint],), depends_on, truth, "pilot cross leak", apply
    )
