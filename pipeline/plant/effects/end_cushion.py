"""`end_cushion`: a longer and narrower cushion slows one joint before one of its limits."""

from typing import NamedTuple

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity, choose_direction, choose_joint, replaced
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.machines.characterise import respond, side
from pipeline.plant.parameters import Parameters

SHORTEST_RAD, LONGEST_RAD = 0.20, 0.40  # at size 1
SMALLEST_AREA, LARGEST_AREA = 0.05, 0.15  # that the cushion leaves, of the metering edge's, at size 1
N_PLACE = 40
SLOW = 0.95  # ratio of speeds
LONG_HOLD_S = 12.0  # enough to cross any joint's range


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
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

    slow = _slow_zone(nominal, apply(nominal), joint, direction, zone)
    name = JOINT_NAMES[joint]
    truth = {
        "zone_length": Quantity(slow.length_rad, "rad"),
        "min_speed_ratio": Quantity(slow.least_ratio, "1"),
        "side": Quantity(direction, "sign"),
    }
    return PlantEffect(
        "end_cushion", "end_cushion", (name,), (f"position:{name}",), truth, "narrow cushion", apply
    )


class SlowZone(NamedTuple):
    """Where a joint is slower than it was, and by how much at most.

    The cushion's orifice begins to throttle only where it is narrower than what throttles anyway: the zone in which
    the joint is slow is shorter than the cushion.
    """

    length_rad: float
    least_ratio: float


def _slow_zone(
    nominal: Parameters, changed: Parameters, joint: int, direction: int, cushion_rad: float
) -> SlowZone:
    """By the ratio of speeds inside the new cushion and before the nominal one."""
    linkage = nominal.linkage
    limit = linkage.upper_rad[joint] if direction > 0 else linkage.lower_rad[joint]
    nominal_zone = nominal.cylinder.cushion_zone_rad[joint, side(direction)]
    distances = np.linspace(cushion_rad, nominal_zone, N_PLACE)
    places = limit - direction * distances
    speeds = []
    for machine in (nominal, changed):
        response = respond(machine, joint, direction, LONG_HOLD_S)
        order = np.argsort(direction * response.angle_rad, kind="stable")
        speeds.append(
            np.interp(direction * places, direction * response.angle_rad[order], response.speed_rad_s[order])
        )
    ratios = speeds[1] / speeds[0]
    is_slow = ratios < SLOW
    length = float(distances[np.argmax(is_slow)]) if is_slow.any() else float(nominal_zone)
    return SlowZone(length, float(np.min(ratios)))
