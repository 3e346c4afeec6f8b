"""`thermal_drift`: the session starts with cold oil, in filters and lines that react to viscosity."""

import numpy as np

from pipeline.plant.characterise import full_speeds
from pipeline.plant.effects.effect import JOINT_NAMES, Effect, Quantity
from pipeline.plant.parameters import Parameters

COLDEST_C, WARMEST_C = 8.0, 16.0  # start of the oil, at size 1; half as far below working temperature at half
# Cold-sensitive lines: blocked line filters have laminar resistance. So much that the loss of speed grows evenly
# with the cold (nominal lines feel nothing above 15 degrees, then everything) and is a few percent with warm oil.
LINE_FACTOR = 20.0
FASTEST_S, SLOWEST_S = 240.0, 600.0  # warm-up


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> Effect:
    """Cold start on a day as cold as the oil, with laminar restrictions in the work lines."""
    start_C = random.uniform(COLDEST_C, WARMEST_C)
    warm_up_s = random.uniform(FASTEST_S, SLOWEST_S)

    def apply(parameters: Parameters) -> Parameters:
        oil = parameters.oil
        start = oil.start_C + size * (start_C - oil.start_C)
        lines = parameters.cylinder.line_resistance_Pa_s_m3 * LINE_FACTOR
        return parameters.change(
            "oil", start_C=start, heat_capacity_J_K=oil.heat_loss_W_K * warm_up_s
        ).change("cylinder", line_resistance_Pa_s_m3=lines)

    changed = apply(nominal)
    warm = full_speeds(changed.change("oil", start_C=nominal.oil.start_C))
    loss = 1.0 - full_speeds(changed) / warm
    truth = {
        "cold_speed_loss": Quantity(float(np.mean(loss)), "1"),
        "time_constant": Quantity(warm_up_s, "s"),
    }
    truth |= {
        f"cold_speed_loss:{n}": Quantity(float(np.mean(loss[j])), "1") for j, n in enumerate(JOINT_NAMES)
    }
    return Effect(
        "thermal_drift", "thermal_drift", JOINT_NAMES, ("time_since_start",), truth, "cold oil", apply
    )
