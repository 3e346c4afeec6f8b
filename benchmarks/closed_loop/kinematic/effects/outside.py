"""Effects that no family of the contract describes: their truth is `other` with what speed depends on."""

import numpy as np

from benchmarks.closed_loop.kinematic.effects.effect import (
    OTHER,
    Apply,
    Effect,
    Kind,
    Quantity,
    choose_joint,
    choose_sign,
    choose_two_joints,
    side,
    with_value,
)
from benchmarks.closed_loop.kinematic.machine import JOINTS, Machine
from benchmarks.closed_loop.kinematic.working_poses import place_within_work
from benchmarks.closed_loop.machines import Variant

# Ranges are at size 1; losses are shares of speed.
CROSSTALK_CHANGE, FASTER_PROBABILITY = (0.15, 0.30), 0.5
HOLD_LOSS, HOLD_S = (0.20, 0.40), (1.0, 3.0)
TRAVEL_LOSS = (0.20, 0.40)  # at the end of a typical session
TYPICAL_TRAVEL_RAD = 43.0  # of a joint in six minutes
ACTIVITY_LOSS, ACTIVITY_S = (0.10, 0.20), (10.0, 30.0)
POSITION_LOSS, POSITION_SHARE = (0.20, 0.40), (0.2, 0.5)  # of the time, until where it begins
BOOST, BOOST_AFTER_S = (0.15, 0.35), (0.8, 1.8)
LOCKOUT_S = (0.15, 0.40)
CYCLE_LOSS, CYCLE_S = (0.20, 0.40), (30.0, 60.0)


def draw_command_crosstalk(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """Speed v_j = r u_j while another joint is commanded in one direction."""
    (joint, source), direction = choose_two_joints(random), choose_sign(random)
    change = size * random.uniform(*CROSSTALK_CHANGE)
    ratio = 1.0 + change if random.random() < FASTER_PROBABILITY else 1.0 - change

    def apply(machine: Machine) -> Machine:
        present = machine.quantities.dependences.command_ratio
        return machine.change(
            "dependences", command_ratio=with_value(present, (joint, source, side(direction)), ratio)
        )

    truth = {"speed_ratio": Quantity(ratio, "1"), "source_direction": Quantity(direction, "sign")}
    return _other(
        "command_crosstalk", joint, f"command:{JOINTS[source]}", truth, "valves pull each other", apply
    )


def draw_hold_fade(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """Speed v = u (1 - c (1 - exp(-h / T))), h being how long the joint's present command has been held."""
    joint = choose_joint(random)
    loss, hold_s = size * random.uniform(*HOLD_LOSS), random.uniform(*HOLD_S)

    def apply(machine: Machine) -> Machine:
        present = machine.quantities.dependences.hold_loss
        return machine.change("dependences", hold_loss=with_value(present, joint, loss), hold_s=hold_s)

    truth = {"held_speed_loss": Quantity(loss, "1"), "time_constant": Quantity(hold_s, "s")}
    return _other("hold_fade", joint, f"hold_time:{JOINTS[joint]}", truth, "valve fades while held", apply)


def draw_travel_wear(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """Speed v = u (1 - c s), s being the way that the joint has gone since the session's start."""
    joint = choose_joint(random)
    loss_per_rad = size * random.uniform(*TRAVEL_LOSS) / TYPICAL_TRAVEL_RAD

    def apply(machine: Machine) -> Machine:
        present = machine.quantities.dependences.travel_loss_per_rad
        return machine.change("dependences", travel_loss_per_rad=with_value(present, joint, loss_per_rad))

    truth = {"speed_loss_per_travel": Quantity(loss_per_rad, "1/rad")}
    return _other("travel_wear", joint, f"travel:{JOINTS[joint]}", truth, "filter clogs with use", apply)


def draw_activity_sag(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """Speed v = u (1 - c A) for all joints, A being the mean |a| of the recent past over a typical one, at most 2."""
    loss, over_s = size * random.uniform(*ACTIVITY_LOSS), random.uniform(*ACTIVITY_S)

    def apply(machine: Machine) -> Machine:
        return machine.change("dependences", activity_loss=loss, activity_s=over_s)

    truth = {"speed_loss": Quantity(loss, "1"), "averaging_time": Quantity(over_s, "s")}
    return Effect(OTHER, "activity_sag", JOINTS, ("activity",), truth, "accumulator runs empty", apply)


def draw_position_crosstalk(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """Speed v_j = u_j (1 - c r) with another joint beyond a place, r growing to 1 within `POSITION_RAMP_RAD`.

    The place lies where that joint works: beyond it all the time, the speed would be lost everywhere, which is a gain.
    """
    joint, source = choose_two_joints(random)
    loss, share = size * random.uniform(*POSITION_LOSS), random.uniform(*POSITION_SHARE)
    begin_rad = place_within_work(variant, source, joint, share)

    def apply(machine: Machine) -> Machine:
        dependences = machine.quantities.dependences
        return machine.change(
            "dependences",
            position_loss=with_value(dependences.position_loss, (joint, source), loss),
            position_rad=with_value(dependences.position_rad, (joint, source), begin_rad),
        )

    truth = {"speed_loss": Quantity(loss, "1"), "begins_at": Quantity(begin_rad, "rad")}
    return _other(
        "position_crosstalk", joint, f"position:{JOINTS[source]}", truth, "hose bent by another joint", apply
    )


def draw_clock_cycle(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """Speed v = u (1 - c) in the first half of each period of the wall clock."""
    joint = choose_joint(random)
    loss, period_s = size * random.uniform(*CYCLE_LOSS), random.uniform(*CYCLE_S)

    def apply(machine: Machine) -> Machine:
        present = machine.quantities.dependences.cycle_loss
        return machine.change("dependences", cycle_loss=with_value(present, joint, loss), cycle_s=period_s)

    truth = {"speed_loss": Quantity(loss, "1"), "period": Quantity(period_s, "s")}
    return _other("clock_cycle", joint, "absolute_time", truth, "timer switches a bypass", apply)


def draw_hold_boost(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """Speed v = u (1 + c) once the joint's present command has been held for longer than a threshold."""
    joint, gain, after_s = choose_joint(random), size * random.uniform(*BOOST), random.uniform(*BOOST_AFTER_S)

    def apply(machine: Machine) -> Machine:
        present = machine.quantities.dependences.boost
        return machine.change("dependences", boost=with_value(present, joint, gain), boost_s=after_s)

    truth = {"speed_gain": Quantity(gain, "1"), "held_for": Quantity(after_s, "s")}
    return _other("hold_boost", joint, f"hold_time:{JOINTS[joint]}", truth, "second pump cuts in", apply)


def draw_reversal_lockout(random: np.random.Generator, variant: Variant, size: float) -> Effect:
    """The valve stays shut for a while once the sign of the command is another than the last one's."""
    joint, lockout_s = choose_joint(random), size * random.uniform(*LOCKOUT_S)

    def apply(machine: Machine) -> Machine:
        present = machine.quantities.dependences.lockout_s
        return machine.change("dependences", lockout_s=with_value(present, joint, lockout_s))

    truth = {"lockout": Quantity(lockout_s, "s")}
    return _other("reversal_lockout", joint, f"reversal:{JOINTS[joint]}", truth, "reversal guard", apply)


def _other(kind: str, joint: int, on: str, truth: dict[str, Quantity], cause: str, apply: Apply) -> Effect:
    return Effect(OTHER, kind, (JOINTS[joint],), (on,), truth, cause, apply)


KINDS = {
    "command_crosstalk": Kind(draw_command_crosstalk, 2.5),  # a quarter of the speed is left
    "hold_fade": Kind(draw_hold_fade, 2.0),  # a fifth is left after a long hold
    "travel_wear": Kind(draw_travel_wear, 2.0),  # a fifth is left at the end
    "activity_sag": Kind(draw_activity_sag, 2.0),  # a fifth is left after hard work
    "position_crosstalk": Kind(draw_position_crosstalk, 2.0),  # a fifth is left
    "clock_cycle": Kind(draw_clock_cycle, 2.0),  # a fifth is left
    "hold_boost": Kind(draw_hold_boost, 2.0),  # 1.7 times as fast
    "reversal_lockout": Kind(draw_reversal_lockout, 2.5),  # 1 s
}
