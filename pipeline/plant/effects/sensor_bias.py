"""`sensor_bias`: an encoder was mounted again with another zero, or its coupling has another ratio."""

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity, added, choose_joint, scaled
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.parameters import Parameters

SMALLEST_OFFSET_RAD, LARGEST_OFFSET_RAD = 0.03, 0.10  # at size 1
SMALLEST_SCALE, LARGEST_SCALE = 0.04, 0.10  # difference to one, at size 1


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """Offset or scale of one encoder."""
    joint = choose_joint(random)
    sign = float(random.choice((-1.0, 1.0)))
    offset, scale = 0.0, 1.0
    if random.random() < 0.5:
        offset = sign * size * random.uniform(SMALLEST_OFFSET_RAD, LARGEST_OFFSET_RAD)
    else:
        scale = 1.0 + sign * size * random.uniform(SMALLEST_SCALE, LARGEST_SCALE)

    def apply(parameters: Parameters) -> Parameters:
        sensor = parameters.sensor
        return parameters.change(
            "sensor",
            offset_rad=added(sensor.offset_rad, joint, offset),
            scale=scaled(sensor.scale, joint, scale),
        )

    name = JOINT_NAMES[joint]
    truth = {"offset": Quantity(offset, "rad"), "scale": Quantity(scale, "1")}
    return PlantEffect(
        "sensor_bias", "sensor_bias", (name,), (f"position:{name}",), truth, "encoder remounted", apply
    )
