"""Effects on the speed that a valve asks for: families of the contract that are a factor on it."""

import numpy as np

from benchmarks.closed_loop.kinematic.effects.effect import (
    Effect,
    Kind,
    Quantity,
    choose_joint,
    choose_sign,
    side,
    with_value,
)
from benchmarks.closed_loop.kinematic.machine import JOINTS, NEGATIVE, POSITIVE, Machine
from benchmarks.closed_loop.kinematic.working_poses import mean_levers
from benchmarks.closed_loop.machines import Variant

# Ranges are at size 1, shares of speed.
GAIN_CHANGE, FASTER_PROBABILITY = (0.15, 0.30), 0.3
COUPLING_LOSS = (0.30, 0.50)
LOAD_LOSS = (0.15, 0.30)
LOAD_SHARE = np.array([0.0, 1.0, 0.6, 0.0])
"""(n,) Of the loss, by how near each cylinder's pressure is to the supply's; the bucket's is far from it."""
COLD_LOSS, WARM_UP_S = (0.20, 0.30), (100.0, 240.0)
SUPPLY_STD, SUPPLY_CORRELATION_S = (0.06, 0.15), (4.0, 15.0)
CUSHION_ZONE_RAD, CUSHION_RATIO = (0.20, 0.40), (0.20, 0.50)


def draw_gain(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """Speed v = r u in one direction of one joint, or in both."""
    joint, direction = choose_joint(random), int(random.choice((-1, 0, 1)))
    change = size * random.uniform(*GAIN_CHANGE)
    ratio = 1.0 + change if random.random() < FASTER_PROBABILITY else 1.0 - change
    sides = [side(direction)] if direction else [NEGATIVE, POSITIVE]

    def apply(machine: Machine) -> Machine:
        speeds = np.array(machine.quantities.speed.full_speed_rad_s)
        speeds[joint, sides] *= ratio
        return machine.change("speed", full_speed_rad_s=speeds)

    name = JOINTS[joint]
    truth = {"speed_ratio": Quantity(ratio, "1"), "direction": Quantity(direction, "sign")}
    return Effect("gain", "gain", (name,), (f"command:{name}",), truth, "flow lost or gained", apply)


def draw_flow_coupling(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """Speed v_j = u_j (1 - λ Σ_{i≠j} |a_i| / (n - 1)) for all joints."""
    loss = size * random.uniform(*COUPLING_LOSS)

    def apply(machine: Machine) -> Machine:
        return machine.change("speed", coupling_loss=loss)

    truth = {"loss_fraction": Quantity(loss, "1")}
    depends_on = tuple(f"command:{name}" for name in JOINTS)
    return Effect("flow_coupling", "flow_coupling", JOINTS, depends_on, truth, "worn pump", apply)


def draw_load(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """Speed v = u (1 - sign(u) h lever(q)) for boom and arm, with the lever of a weight at the tip (`read_levers`).

    The truth's ratios are means of the factor over the poses in which the variant's nominal sessions have the joint
    commanded in that direction, up being the positive one; beside each joint's their mean over both.
    """
    losses = size * random.uniform(*LOAD_LOSS) * LOAD_SHARE

    def apply(machine: Machine) -> Machine:
        return machine.change("speed", load_loss=losses)

    affected = np.flatnonzero(losses)
    truth = {}
    for name, sign in (("mean_speed_ratio_up", 1), ("mean_speed_ratio_down", -1)):
        ratios = 1.0 - sign * losses * mean_levers(variant)[:, side(sign)]
        truth[name] = Quantity(float(ratios[affected].mean()), "1")
        truth |= {f"{name}:{JOINTS[joint]}": Quantity(float(ratios[joint]), "1") for joint in affected}
    depends_on = tuple(f"position:{name}" for name in JOINTS[1:])
    joints = tuple(JOINTS[joint] for joint in affected)
    return Effect("load", "load", joints, depends_on, truth, "payload at the chisel", apply)


def draw_thermal_drift(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """Speed v = u (1 - c exp(-t / T)) for all joints, t since the session's start."""
    loss, warm_up_s = size * random.uniform(*COLD_LOSS), random.uniform(*WARM_UP_S)

    def apply(machine: Machine) -> Machine:
        return machine.change("speed", cold_loss=loss, warm_up_s=warm_up_s)

    truth = {"cold_speed_loss": Quantity(loss, "1"), "time_constant": Quantity(warm_up_s, "s")}
    return Effect("thermal_drift", "thermal_drift", JOINTS, ("time_since_start",), truth, "cold oil", apply)


def draw_supply_variation(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """Speed v = u exp(x) for all joints, x an Ornstein-Uhlenbeck process."""
    std, correlation_s = size * random.uniform(*SUPPLY_STD), random.uniform(*SUPPLY_CORRELATION_S)

    def apply(machine: Machine) -> Machine:
        return machine.change("speed", supply_std=std, supply_correlation_s=correlation_s)

    truth = {"std_log_speed": Quantity(std, "1"), "correlation_time": Quantity(correlation_s, "s")}
    return Effect(
        "supply_variation", "supply_variation", JOINTS, ("latent",), truth, "hunting governor", apply
    )


def draw_end_cushion(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """Speed v = u (m + (1 - m) d / L) towards one limit at a distance d < L.

    L is in proportion to the size, and so is the logarithm of m, so m stays between 0 and 1.
    """
    joint, sign = choose_joint(random), choose_sign(random)
    zone_rad = size * random.uniform(*CUSHION_ZONE_RAD)
    ratio = float(random.uniform(*CUSHION_RATIO) ** size)

    def apply(machine: Machine) -> Machine:
        speed, index = machine.quantities.speed, (joint, side(sign))
        return machine.change(
            "speed",
            cushion_zone_rad=with_value(speed.cushion_zone_rad, index, zone_rad),
            cushion_ratio=with_value(speed.cushion_ratio, index, ratio),
        )

    name = JOINTS[joint]
    truth = {
        "zone_length": Quantity(zone_rad, "rad"),
        "min_speed_ratio": Quantity(ratio, "1"),
        "side": Quantity(sign, "sign"),
    }
    return Effect(
        "end_cushion", "end_cushion", (name,), (f"position:{name}",), truth, "narrow cushion", apply
    )


KINDS = {
    "gain": Kind(draw_gain, 2.5),  # a quarter of the speed is left
    "flow_coupling": Kind(draw_flow_coupling, 1.6),  # a fifth is left while all others move
    "load": Kind(draw_load, 2.0),  # two fifths are left of the boom's speed with the arm stretched out
    "thermal_drift": Kind(draw_thermal_drift, 2.5),  # a quarter is left at the start
    "supply_variation": Kind(draw_supply_variation, 2.5),  # wanders by 38 %
    "end_cushion": Kind(draw_end_cushion, 2.0),  # 0.8 rad, down to 4 % of the speed
}
