"""`other`: a solenoid without current control warms up while held, so the joint slows with hold time."""

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity, choose_joint, replaced
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.parameters import Parameters

SMALLEST, LARGEST = 0.25, 0.40  # of pilot pressure, at size 1
SHORTEST_S, LONGEST_S = 1.5, 4.0


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """Both coils of one joint lose force as they warm up."""
    joint = choose_joint(random)
    fade = size * random.uniform(SMALLEST, LARGEST)
    constant_s = random.uniform(SHORTEST_S, LONGEST_S)

    def apply(parameters: Parameters) -> Parameters:
        return parameters.change(
            "pilot",
            coil_fade=replaced(parameters.pilot.coil_fade, joint, fade),
            coil_time_constant_s=constant_s,
        )

    name = JOINT_NAMES[joint]
    truth = {"pilot_loss": Quantity(fade, "1"), "time_constant": Quantity(constant_s, "s")}
    return PlantEffect("other", "coil_fade", (name,), (f"hold_time:{name}",), truth, "coil warms up", apply)
