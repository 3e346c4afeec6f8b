"""`backlash`: a worn pin leaves clearance between cylinder and link."""

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity, added, choose_joint
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.parameters import Parameters

SMALLEST_RAD, LARGEST_RAD = 0.02, 0.06  # at size 1


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """Clearance of one joint, as play in joint angle."""
    joint = choose_joint(random)
    width = size * random.uniform(SMALLEST_RAD, LARGEST_RAD)

    def apply(parameters: Parameters) -> Parameters:
        return parameters.change("linkage", play_rad=added(parameters.linkage.play_rad, joint, width))

    name = JOINT_NAMES[joint]
    truth = {"width": Quantity(width, "rad")}
    return PlantEffect("backlash", "backlash", (name,), (f"reversal:{name}",), truth, "worn pin", apply)
