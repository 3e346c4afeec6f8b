"""`other`: a hose kinks when another joint is turned far to one side and throttles this one."""

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity, choose_direction, replaced
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES, N_JOINT
from pipeline.plant.parameters import Parameters

SMALLEST_PA_S_M3, LARGEST_PA_S_M3 = 4.0e10, 9.0e10  # per radian beyond the onset, at size 1


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """Work lines of one joint, from the middle of another joint's range on."""
    joint, source = (int(j) for j in random.choice(N_JOINT, 2, replace=False))
    direction = choose_direction(random)
    resistance = size * random.uniform(SMALLEST_PA_S_M3, LARGEST_PA_S_M3)
    middle = 0.5 * float(nominal.linkage.lower_rad[source] + nominal.linkage.upper_rad[source])

    def apply(parameters: Parameters) -> Parameters:
        cylinder = parameters.cylinder
        return parameters.change(
            "cylinder",
            kink_source=replaced(cylinder.kink_source, joint, source),
            kink_onset_rad=replaced(cylinder.kink_onset_rad, joint, middle),
            kink_side=replaced(cylinder.kink_side, joint, direction),
            kink_resistance_Pa_s_m3_rad=replaced(cylinder.kink_resistance_Pa_s_m3_rad, joint, resistance),
        )

    truth = {
        "resistance_per_angle": Quantity(resistance, "Pa s/m3/rad"),
        "onset": Quantity(middle, "rad"),
        "side": Quantity(direction, "sign"),
    }
    depends_on = (f"position:{JOINT_NAMES[source]}",)
    return PlantEffect("other", "hose_kink", (JOINT_NAMES[joint],), depends_on, truth, "kinked hose", apply)
