"""`stiction`: contaminated oil silts up a spool at rest, which then lets go late (Merritt, section 11-4)."""

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity, choose_joint, scaled
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.machines.characterise import start_time
from pipeline.plant.parameters import Parameters

WEAKEST, STRONGEST = 0.70, 0.90  # of the pilot pressure that is left above the preload, at size 1
SHORTEST_S, LONGEST_S = 0.3, 1.0  # growth of the lock with rest
SPREAD = 0.08  # of the lock from one start to the next; the nominal one would let many starts fail for good
LONG_REST_S = 4.0


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """The silt lock of one joint's spool."""
    joint = choose_joint(random)
    spare_Pa = float(np.min(nominal.pilot.set_pressure_Pa[joint])) - nominal.spool.preload_Pa
    lock_Pa = size * random.uniform(WEAKEST, STRONGEST) * spare_Pa
    growth_s = random.uniform(SHORTEST_S, LONGEST_S)

    def apply(parameters: Parameters) -> Parameters:
        present = parameters.spool.silt_pressure_Pa
        return parameters.change(
            "spool",
            silt_pressure_Pa=scaled(present, joint, lock_Pa / present[joint]),
            silt_time_constant_s=growth_s,
            silt_spread=SPREAD,
        )

    changed = apply(nominal)
    late = [
        start_time(changed, joint, d, LONG_REST_S) - start_time(nominal, joint, d, LONG_REST_S)
        for d in (-1, 1)
    ]
    name = JOINT_NAMES[joint]
    truth = {
        "mean_extra_time": Quantity(float(np.mean(late)), "s"),
        "rest_threshold": Quantity(growth_s, "s"),
    }
    return PlantEffect("stiction", "stiction", (name,), (f"rest_time:{name}",), truth, "silted spool", apply)
