"""`other`: dirt collects in one joint's line filter, so the joint slows as its travel adds up."""

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity, choose_joint, replaced
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.parameters import Parameters

SMALLEST_PER_M3, LARGEST_PER_M3 = 1.5e3, 4.0e3  # relative growth of line resistance, at size 1


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """The lines of one joint clog with the oil that passes them."""
    joint = choose_joint(random)
    rate = size * random.uniform(SMALLEST_PER_M3, LARGEST_PER_M3)

    def apply(parameters: Parameters) -> Parameters:
        clogging = replaced(parameters.cylinder.line_clogging_per_m3, joint, rate)
        return parameters.change("cylinder", line_clogging_per_m3=clogging)

    name = JOINT_NAMES[joint]
    truth = {"resistance_growth": Quantity(rate, "1/m3")}
    return PlantEffect(
        "other", "line_clogging", (name,), (f"travel:{name}",), truth, "clogging line filter", apply
    )
