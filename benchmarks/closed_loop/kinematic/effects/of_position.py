"""Effects on the way from speed to reading: leakage, backlash, sensor bias, timing."""

import numpy as np

from benchmarks.closed_loop.kinematic.effects.effect import (
    Effect,
    Kind,
    Quantity,
    choose_joint,
    choose_sign,
    with_value,
)
from benchmarks.closed_loop.kinematic.machine import JOINTS, Machine
from benchmarks.closed_loop.machines import Variant

# Ranges are at size 1.
SAGGING_JOINTS = (1, 2)  # boom and arm: gravity pulls them down nearly everywhere
SAG_RATE_RAD_S = (0.006, 0.02)
PLAY_RAD = (0.03, 0.08)
OFFSET_PROBABILITY = 0.4  # else the scale changes
OFFSET_RAD, SCALE_CHANGE = (0.03, 0.07), (0.05, 0.10)
LATENCY_S = (0.10, 0.20)
LATENCY_JITTER_S = 0.01  # and at most the latency: no reading is from the future


def draw_leakage(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """Speed v = u - s while one joint's command is zero."""
    joint = int(random.choice(SAGGING_JOINTS))
    rate_rad_s = -size * random.uniform(*SAG_RATE_RAD_S)

    def apply(machine: Machine) -> Machine:
        present = machine.quantities.motion.sag_rate_rad_s
        return machine.change("motion", sag_rate_rad_s=with_value(present, joint, rate_rad_s))

    name, truth = JOINTS[joint], {"sag_rate": Quantity(rate_rad_s, "rad/s")}
    return Effect("leakage", "leakage", (name,), (f"zero_command:{name}",), truth, "worn seals", apply)


def draw_backlash(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """The play operator: one joint's link stays within half the width of its drive."""
    joint = choose_joint(random)
    width_rad = size * random.uniform(*PLAY_RAD)

    def apply(machine: Machine) -> Machine:
        return machine.change(
            "motion", play_rad=with_value(machine.quantities.motion.play_rad, joint, width_rad)
        )

    name, truth = JOINTS[joint], {"width": Quantity(width_rad, "rad")}
    return Effect("backlash", "backlash", (name,), (f"reversal:{name}",), truth, "worn pin", apply)


def draw_sensor_bias(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """Reading y = k q + o of one encoder; either the offset or the scale is another."""
    joint, sign = choose_joint(random), choose_sign(random)
    offset_rad, scale = 0.0, 1.0
    if random.random() < OFFSET_PROBABILITY:
        offset_rad = sign * size * random.uniform(*OFFSET_RAD)
    else:
        scale = 1.0 + sign * size * random.uniform(*SCALE_CHANGE)

    def apply(machine: Machine) -> Machine:
        encoder = machine.quantities.encoder
        return machine.change(
            "encoder",
            offset_rad=with_value(encoder.offset_rad, joint, offset_rad),
            scale=with_value(encoder.scale, joint, scale),
        )

    name = JOINTS[joint]
    truth = {"offset": Quantity(offset_rad, "rad"), "scale": Quantity(scale, "1")}
    return Effect(
        "sensor_bias", "sensor_bias", (name,), (f"position:{name}",), truth, "encoder remounted", apply
    )


def draw_timing(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """Reading y(t) = q(t - L) for all joints, L even within the jitter about its mean."""
    latency_s = size * random.uniform(*LATENCY_S)

    def apply(machine: Machine) -> Machine:
        return machine.change(
            "encoder", latency_s=latency_s, latency_jitter_s=min(LATENCY_JITTER_S, latency_s)
        )

    truth = {"latency": Quantity(latency_s, "s")}
    return Effect("timing", "timing", JOINTS, ("clock",), truth, "congested encoder bus", apply)


KINDS = {
    "leakage": Kind(draw_leakage, 4.0),  # 0.08 rad/s
    "backlash": Kind(draw_backlash, 2.5),  # 0.2 rad
    "sensor_bias": Kind(draw_sensor_bias, 2.5),  # 0.18 rad, or a quarter of the scale
    "timing": Kind(draw_timing, 2.0),  # 0.4 s
}
