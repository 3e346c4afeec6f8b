"""`gain`: a worn or silted metering edge changes the opening of one spool, in one direction or both."""

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity, choose_joint, scaled
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.machines.characterise import full_speed, side
from pipeline.plant.parameters import Parameters

SMALLEST_CHANGE, LARGEST_CHANGE = 0.18, 0.45  # of metering area, at size 1
FASTER_PROBABILITY = 0.3


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """Both metering edges of one spool, for one or both directions, lose (or gain) area."""
    joint, direction = choose_joint(random), int(random.choice((-1, 0, 1)))
    change = size * random.uniform(SMALLEST_CHANGE, LARGEST_CHANGE)
    factor = 1.0 + change if random.random() < FASTER_PROBABILITY else 1.0 - change
    sides = [side(direction)] if direction else [0, 1]

    def apply(parameters: Parameters) -> Parameters:
        spool = parameters.spool
        return parameters.change(
            "spool",
            inlet_area_m2=scaled(spool.inlet_area_m2, (joint, sides), factor),
            outlet_area_m2=scaled(spool.outlet_area_m2, (joint, sides), factor),
        )

    changed = apply(nominal)
    moved = [direction] if direction else [-1, 1]
    ratio = np.mean([full_speed(changed, joint, d) / full_speed(nominal, joint, d) for d in moved])
    truth = {"speed_ratio": Quantity(float(ratio), "1"), "direction": Quantity(direction, "sign")}
    name = JOINT_NAMES[joint]
    return PlantEffect(
        "gain", "gain", (name,), (f"command:{name}",), truth, "metering edge worn or silted", apply
    )
