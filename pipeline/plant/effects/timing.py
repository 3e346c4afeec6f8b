"""`timing`: readings are old when they get their stamp, jitter more, and some are lost."""

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.parameters import Parameters

SHORTEST_S, LONGEST_S = 0.06, 0.20  # at size 1
MOST_DROPPED = 0.2


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """A congested bus between encoders and computer."""
    lateness_s = size * random.uniform(SHORTEST_S, LONGEST_S)
    dropped = random.uniform(0.0, MOST_DROPPED)

    def apply(parameters: Parameters) -> Parameters:
        late = parameters.sensor.stamp_lateness_s + lateness_s
        return parameters.change("sensor", stamp_lateness_s=late, drop_probability=dropped)

    truth = {"latency": Quantity(lateness_s, "s"), "dropped": Quantity(dropped, "1")}
    return PlantEffect("timing", "timing", JOINT_NAMES, ("clock",), truth, "congested encoder bus", apply)
