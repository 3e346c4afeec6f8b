"""Effects on the way from the stick to the valve, and on the response to it: delay, stiction, lag, oscillation."""

import numpy as np

from benchmarks.closed_loop.kinematic.effects.effect import Effect, Kind, Quantity, choose_joint, with_value
from benchmarks.closed_loop.kinematic.machine import JOINTS, Machine
from benchmarks.closed_loop.machines import Variant

# Ranges are at size 1.
DELAY_S = (0.10, 0.25)
EXTRA_TIME_S, REST_THRESHOLD_S = (0.15, 0.35), (0.3, 1.0)
TIME_CONSTANT_S = (0.15, 0.30)
FREQUENCY_HZ, DAMPING_RATIO = (1.2, 2.0), (0.06, 0.15)


def draw_delay(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """a'(t) = a(t - θ): all commands of one joint arrive later."""
    joint = choose_joint(random)
    delay_s = size * random.uniform(*DELAY_S)

    def apply(machine: Machine) -> Machine:
        present = machine.quantities.command_path.dead_time_s
        return machine.change(
            "command_path", dead_time_s=with_value(present, joint, present[joint] + delay_s)
        )

    name, truth = JOINTS[joint], {"added_delay": Quantity(delay_s, "s")}
    return Effect("delay", "delay", (name,), (f"command:{name}",), truth, "slow output stage", apply)


def draw_stiction(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """After a rest longer than the threshold a start takes extra time, from a gamma distribution; see `receive`."""
    joint = choose_joint(random)
    extra_s, threshold_s = size * random.uniform(*EXTRA_TIME_S), random.uniform(*REST_THRESHOLD_S)

    def apply(machine: Machine) -> Machine:
        path = machine.quantities.command_path
        return machine.change(
            "command_path",
            mean_extra_time_s=with_value(path.mean_extra_time_s, joint, extra_s),
            rest_threshold_s=with_value(path.rest_threshold_s, joint, threshold_s),
        )

    name = JOINTS[joint]
    truth = {"mean_extra_time": Quantity(extra_s, "s"), "rest_threshold": Quantity(threshold_s, "s")}
    return Effect("stiction", "stiction", (name,), (f"rest_time:{name}",), truth, "valve sticks", apply)


def draw_lag(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """τ v̇ = u - v behind the speed u that one joint had."""
    joint = choose_joint(random)
    added_s = size * random.uniform(*TIME_CONSTANT_S)

    def apply(machine: Machine) -> Machine:
        present = machine.quantities.motion.added_time_constant_s
        return machine.change("motion", added_time_constant_s=with_value(present, joint, added_s))

    name, truth = JOINTS[joint], {"added_time_constant": Quantity(added_s, "s")}
    return Effect("lag", "lag", (name,), (f"command_history:{name}",), truth, "throttled line", apply)


def draw_oscillation(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """v̈ = ω² (u - v) - 2 ζ ω v̇ behind the speed u that one joint had; its compliance is in proportion to the size."""
    joint = choose_joint(random)
    frequency_Hz, damping = random.uniform(*FREQUENCY_HZ) / np.sqrt(size), random.uniform(*DAMPING_RATIO)

    def apply(machine: Machine) -> Machine:
        motion = machine.quantities.motion
        return machine.change(
            "motion",
            resonance_Hz=with_value(motion.resonance_Hz, joint, frequency_Hz),
            damping_ratio=with_value(motion.damping_ratio, joint, damping),
        )

    name = JOINTS[joint]
    truth = {"frequency": Quantity(float(frequency_Hz), "Hz"), "damping_ratio": Quantity(damping, "1")}
    depends_on = (f"time_since_stop:{name}",)
    return Effect("oscillation", "oscillation", (name,), depends_on, truth, "compliant transmission", apply)


KINDS = {
    "delay": Kind(draw_delay, 2.5),  # 0.6 s
    "stiction": Kind(draw_stiction, 3.0),  # 1 s
    "lag": Kind(draw_lag, 4.0),  # 1.2 s
    "oscillation": Kind(draw_oscillation, 4.0),  # 0.6 Hz: a quarter of the stiffness
}
