"""`lag`: a throttled pilot line makes the build-up and decay of one joint's pilot pressure slower."""

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity, added, choose_joint
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.parameters import Parameters

SMALLEST_S, LARGEST_S = 0.15, 0.40  # at size 1


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """Both time constants of both directions of one joint grow by the same amount."""
    joint = choose_joint(random)
    added_s = size * random.uniform(SMALLEST_S, LARGEST_S)

    def apply(parameters: Parameters) -> Parameters:
        pilot = parameters.pilot
        return parameters.change(
            "pilot",
            rise_time_constant_s=added(pilot.rise_time_constant_s, joint, added_s),
            fall_time_constant_s=added(pilot.fall_time_constant_s, joint, added_s),
        )

    name = JOINT_NAMES[joint]
    truth = {"added_time_constant": Quantity(added_s, "s")}
    return PlantEffect(
        "lag", "lag", (name,), (f"command_history:{name}",), truth, "throttled pilot lines", apply
    )
