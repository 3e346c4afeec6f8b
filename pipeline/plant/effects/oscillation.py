"""`oscillation`: a soft hose and entrapped air in one joint's lines, with little friction left to damp."""

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity, replaced, scaled
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.machines.characterise import mean_ringing
from pipeline.plant.parameters import Parameters

STIFFEST_PA, SOFTEST_PA = 1.2e8, 4.0e7  # equivalent bulk modulus of the hose at size 1
JOINTS = (0, 1)  # the ones with enough inertia to ring visibly
FRICTION_LEFT = 0.3


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """Hose modulus and friction of one joint."""
    joint = int(random.choice(JOINTS))
    modulus = random.uniform(SOFTEST_PA, STIFFEST_PA) / size

    def apply(parameters: Parameters) -> Parameters:
        friction = parameters.friction
        return parameters.change(
            "oil", hose_modulus_Pa=replaced(parameters.oil.hose_modulus_Pa, joint, modulus)
        ).change(
            "friction",
            coulomb_N=scaled(friction.coulomb_N, joint, FRICTION_LEFT),
            viscous_N_s_m=scaled(friction.viscous_N_s_m, joint, FRICTION_LEFT),
            pin_Nm=scaled(friction.pin_Nm, joint, FRICTION_LEFT),
        )

    name = JOINT_NAMES[joint]
    truth = {"hose_modulus": Quantity(modulus, "Pa")}
    found = mean_ringing(apply(nominal), joint, 1)
    if found is not None:
        truth |= {
            "frequency": Quantity(found.frequency_Hz, "Hz"),
            "damping_ratio": Quantity(found.damping_ratio, "1"),
        }
    return PlantEffect(
        "oscillation", "oscillation", (name,), (f"time_since_stop:{name}",), truth, "soft hose", apply
    )
