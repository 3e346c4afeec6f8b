"""`flow_coupling`: a worn pump delivers less, so joints that move at once take flow from each other."""

import numpy as np

from pipeline.errors import InputError
from pipeline.plant.effects.effect import PlantEffect, Quantity
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES, N_JOINT
from pipeline.plant.machines.characterise import full_speed
from pipeline.plant.parameters import Parameters

SMALLEST_LOSS, LARGEST_LOSS = 0.25, 0.45  # of pump flow, at size 1
SINGLE_DEMAND = 0.30  # of nominal pump flow: what one motion of this machine takes
SMALLEST_BYPASS = 0.2
LEAST_LOSS = 0.05  # a joint that loses less is not counted as affected


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """The pump loses flow and the open centre is throttled equally, so that single motions keep their speed.

    Raises:
        InputError: So large an effect would leave less flow than one motion takes.
    """
    factor = 1.0 - size * random.uniform(SMALLEST_LOSS, LARGEST_LOSS)
    if factor < SINGLE_DEMAND:
        most = (1.0 - SINGLE_DEMAND) / LARGEST_LOSS
        raise InputError(
            f"effect flow_coupling: size {size:g} leaves no motion enough flow; at most {most:.1f}"
        )

    def apply(parameters: Parameters) -> Parameters:
        # single motions keep their supply pressure when the bypass passes as much less as the pump delivers
        single = parameters.supply.pump_flow_m3_s * SINGLE_DEMAND
        left = parameters.supply.pump_flow_m3_s - single
        narrowed = (parameters.supply.pump_flow_m3_s * factor - single) / left
        spool = parameters.spool
        return parameters.change("supply", pump_flow_m3_s=parameters.supply.pump_flow_m3_s * factor).change(
            "spool",
            bypass_closed_area_m2=spool.bypass_closed_area_m2 * max(narrowed, SMALLEST_BYPASS),
        )

    changed = apply(nominal)
    losses, joints = {}, []
    for joint, name in enumerate(JOINT_NAMES):
        others = np.ones(N_JOINT)
        shares = [
            full_speed(machine, joint, 1, others=others) / full_speed(machine, joint, 1)
            for machine in (nominal, changed)
        ]
        losses[name] = 1.0 - shares[1] / shares[0]
        if losses[name] > LEAST_LOSS:
            joints.append(name)
    truth = {
        "loss_fraction": Quantity(float(np.mean([losses[name] for name in joints])) if joints else 0.0, "1")
    }
    truth |= {f"loss_fraction:{name}": Quantity(float(loss), "1") for name, loss in losses.items()}
    depends_on = tuple(f"command:{name}" for name in JOINT_NAMES)
    return PlantEffect("flow_coupling", "flow_coupling", tuple(joints), depends_on, truth, "worn pump", apply)
