"""`delay`: extra dead time of one joint's pilot lines (bus load, slow output stage)."""

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity, added, choose_joint
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.parameters import Parameters

SHORTEST_S, LONGEST_S = 0.10, 0.30  # at size 1


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """Both directions of one joint get the same added dead time."""
    joint = choose_joint(random)
    delay_s = size * random.uniform(SHORTEST_S, LONGEST_S)

    def apply(parameters: Parameters) -> Parameters:
        return parameters.change("pilot", dead_time_s=added(parameters.pilot.dead_time_s, joint, delay_s))

    name = JOINT_NAMES[joint]
    truth = {"added_delay": Quantity(delay_s, "s")}
    return PlantEffect("delay", "delay", (name,), (f"command:{name}",), truth, "extra pilot dead time", apply)
