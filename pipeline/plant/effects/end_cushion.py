"""`end_cushion`: a longer and narrower cushion slows one joint before one of its limits."""

import numpy as np

from pipeline.plant.characterise import respond, side
from pipeline.plant.effects.effect import (
    JOINT_NAMES,
    Effect,
    Quantity,
    choose_direction,
    choose_joint,
    replaced,
)
from pipeline.plant.parameters import Parameters

SHORTEST_RAD, LONGEST_RAD = 0.20, 0.40  # at size 1
SMALLEST_AREA, LARGEST_AREA = 0.05, 0.15  # that the cushion leaves, of the metering edge's, at size 1
N_PLACE = 20
LONG_HOLD_S = 12.0  # enough to cross any joint's range


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> Effect:
    """Cushion of one joint on one side."""
    joint, direction = choose_joint(random), choose_direction(random)
    zone = size * random.uniform(SHORTEST_RAD, LONGEST_RAD)
    index = (joint, side(direction))
    area = random.uniform(SMALLEST_AREA, LARGEST_AREA) / size * float(nominal.spool.outlet_area_m2[index])

    def apply(parameters: Parameters) -> Parameters:
        cylinder = parameters.cylinder
        return parameters.change(
            "cylinder",
            cushion_zone_rad=replaced(cylinder.cushion_zone_rad, index, zone),
            cushion_area_m2=replaced(cylinder.cushion_area_m2, index, area),
        )

    name = JOINT_NAMES[joint]
    truth = {
        "zone_length": Quantity(zone, "rad"),
        "min_speed_ratio": Quantity(_least_ratio(nominal, apply(nominal), joint, direction, zone), "1"),
        "side": Quantity(direction, "sign"),
    }
    return Effect(
        "end_cushion", "end_cushion", (name,), (f"position:{name}",), truth, "narrow cushion", apply
    )


def _least_ratio(nominal: Parameters, changed: Parameters, joint: int, direction: int, zone: float) -> float:
    """Least ratio of speeds inside the new zone and before the nominal one."""
    linkage = nominal.linkage
    limit = linkage.upper_rad[joint] if direction > 0 else linkage.lower_rad[joint]
    nominal_zone = nominal.cylinder.cushion_zone_rad[joint, side(direction)]
    places = limit - direction * np.linspace(zone, nominal_zone, N_PLACE)
    speeds = []
    for machine in (nominal, changed):
        response = respond(machine, joint, direction, LONG_HOLD_S)
        order = np.argsort(direction * response.angle_rad, kind="stable")
        speeds.append(
            np.interp(direction * places, direction * response.angle_rad[order], response.speed_rad_s[order])
        )
    ratios = speeds[1] / speeds[0]
    return float(np.min(ratios))
