"""`load`: a payload hangs at the chisel's tip."""

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.machines.characterise import mean_full_speed
from pipeline.plant.parameters import Parameters

LIGHTEST_KG, HEAVIEST_KG = 40.0, 90.0  # at size 1
LEAST_CHANGE = 0.03  # of speed: a joint that changes less is not counted as affected


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """A point mass at the tip."""
    mass_kg = size * random.uniform(LIGHTEST_KG, HEAVIEST_KG)

    def apply(parameters: Parameters) -> Parameters:
        return parameters.change("links", payload_kg=parameters.links.payload_kg + mass_kg)

    changed = apply(nominal)
    truth, joints, ratios = {}, [], []
    for joint in range(1, len(JOINT_NAMES)):  # gravity does not act on swing
        down, up = (mean_full_speed(changed, joint, d) / mean_full_speed(nominal, joint, d) for d in (-1, 1))
        truth[f"mean_speed_ratio_up:{JOINT_NAMES[joint]}"] = Quantity(up, "1")
        truth[f"mean_speed_ratio_down:{JOINT_NAMES[joint]}"] = Quantity(down, "1")
        if max(abs(up - 1.0), abs(down - 1.0)) > LEAST_CHANGE:
            joints.append(JOINT_NAMES[joint])
            ratios.append((up, down))
    mean = np.mean(ratios, axis=0) if ratios else np.ones(2)
    truth["mean_speed_ratio_up"] = Quantity(float(mean[0]), "1")
    truth["mean_speed_ratio_down"] = Quantity(float(mean[1]), "1")
    truth["payload"] = Quantity(mass_kg, "kg")
    depends_on = tuple(f"position:{name}" for name in JOINT_NAMES[1:])
    return PlantEffect("load", "load", tuple(joints), depends_on, truth, "payload at the chisel", apply)
