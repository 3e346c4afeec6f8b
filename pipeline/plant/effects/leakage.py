"""`leakage`: a worn spool and piston seal let the load sag at zero command."""

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity, added
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.machines.characterise import mean_sag_rate, sag_rate
from pipeline.plant.parameters import Parameters

SMALLEST_RAD_S, LARGEST_RAD_S = 0.012, 0.035  # sag in the middle configuration, at size 1
JOINTS = (1, 2)  # boom and arm: gravity outweighs friction in most of their range
TRIAL_LEAK_M3 = 1.0e-14
N_SECANT = 4


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """Leak from both chambers of one gravity-loaded joint to tank, and past its piston."""
    joint = int(random.choice(JOINTS))
    wanted = size * random.uniform(SMALLEST_RAD_S, LARGEST_RAD_S)

    def leaking(parameters: Parameters, leak: float) -> Parameters:
        cylinder = parameters.cylinder
        return parameters.change(
            "cylinder",
            tank_leakage_m3=added(cylinder.tank_leakage_m3, joint, leak),
            cross_leakage_m3=added(cylinder.cross_leakage_m3, joint, leak),
        )

    leak = TRIAL_LEAK_M3
    for _ in range(N_SECANT):  # sag is nearly proportional to the leak
        leak *= wanted / max(abs(sag_rate(leaking(nominal, leak), joint)), 0.01 * wanted)
    rate = mean_sag_rate(leaking(nominal, leak), joint)
    name = JOINT_NAMES[joint]
    truth = {"sag_rate": Quantity(rate, "rad/s")}
    depends_on = (f"zero_command:{name}",)
    return PlantEffect(
        "leakage", "leakage", (name,), depends_on, truth, "worn seals", lambda p: leaking(p, leak)
    )
