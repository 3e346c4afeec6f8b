"""`other`: a weak pilot pump falls short after much activity, so all joints slow down after busy spells."""

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.parameters import Parameters

SMALLEST, LARGEST = 0.5, 0.9  # of pilot pressure if all joints moved all the time, at size 1
SHORTEST_S, LONGEST_S = 10.0, 40.0


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """The pilot supply sags with the recent share of active pilots."""
    sag = size * random.uniform(SMALLEST, LARGEST)
    constant_s = random.uniform(SHORTEST_S, LONGEST_S)

    def apply(parameters: Parameters) -> Parameters:
        return parameters.change("pilot", supply_sag=sag, supply_time_constant_s=constant_s)

    truth = {"pilot_loss_at_full_activity": Quantity(sag, "1"), "time_constant": Quantity(constant_s, "s")}
    return PlantEffect(
        "other", "pilot_supply_sag", JOINT_NAMES, ("activity",), truth, "weak pilot pump", apply
    )
