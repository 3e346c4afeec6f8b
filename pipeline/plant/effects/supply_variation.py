"""`supply_variation`: a hunting governor lets engine speed, and so pump flow, wander."""

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.machines.characterise import full_speeds
from pipeline.plant.parameters import Parameters

SMALLEST_STD, LARGEST_STD = 0.08, 0.16  # of engine speed, at size 1
SHORTEST_S, LONGEST_S = 4.0, 20.0


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """Relative engine speed is an Ornstein-Uhlenbeck process."""
    std = size * random.uniform(SMALLEST_STD, LARGEST_STD)
    correlation_s = random.uniform(SHORTEST_S, LONGEST_S)

    def apply(parameters: Parameters) -> Parameters:
        return parameters.change("supply", ripple_std=std, ripple_correlation_s=correlation_s)

    flow = nominal.supply.pump_flow_m3_s
    faster = full_speeds(nominal.change("supply", pump_flow_m3_s=flow * (1.0 + std)))
    slower = full_speeds(nominal.change("supply", pump_flow_m3_s=flow * (1.0 - std)))
    truth = {
        "std_log_speed": Quantity(float(np.mean(0.5 * np.log(faster / slower))), "1"),
        "correlation_time": Quantity(correlation_s, "s"),
    }
    return PlantEffect(
        "supply_variation", "supply_variation", JOINT_NAMES, ("latent",), truth, "hunting governor", apply
    )
