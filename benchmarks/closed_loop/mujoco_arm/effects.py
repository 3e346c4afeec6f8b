"""Effects of an arm: one function per kind, which changes its parts and says what the contract calls that.

Truths state the contract's parameters where they are a part's own quantity or follow from one in closed form. What
only a measurement on this arm could tell is left out, and is not scored.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.closed_loop.kinematic.effects.effect import (
    OTHER,
    Apply,
    Effect,
    Quantity,
    choose_sign,
    side,
    with_value,
)
from benchmarks.closed_loop.mujoco_arm.arm import Arm
from pipeline.errors import InputError
from pipeline.machine.specification import JointKind

Draw = Callable[[np.random.Generator, Arm, float], Effect]
"""(chances of joint, direction and strength; the arm; size) -> effect. Ranges in the code are at size 1."""


def _joints(arm: Arm) -> tuple[str, ...]:
    return arm.specification.joint_names


def _choose(random: np.random.Generator, arm: Arm) -> int:
    return int(random.integers(len(arm.links)))


def _choose_two(random: np.random.Generator, arm: Arm) -> tuple[int, int]:
    one, other = random.choice(len(arm.links), 2, replace=False).tolist()
    return one, other


def _one(
    kind: str, arm: Arm, joint: int, on: str, truth: dict[str, Quantity], cause: str, apply: Apply
) -> Effect:
    name = _joints(arm)[joint]
    return Effect(kind, kind, (name,), (f"{on}:{name}",), truth, cause, apply)


def _all(
    kind: str, arm: Arm, on: tuple[str, ...], truth: dict[str, Quantity], cause: str, apply: Apply
) -> Effect:
    return Effect(kind, kind, _joints(arm), on, truth, cause, apply)


def _other(kind: str, arm: Arm, joint: int, on: str, cause: str, apply: Apply) -> Effect:
    return Effect(OTHER, kind, (_joints(arm)[joint],), (on,), {}, cause, apply)


def _joint_unit(arm: Arm, joint: int) -> tuple[float, str]:
    """Metres of the rod per unit of the joint in the middle of its range, and that unit."""
    return arm.links[joint].lever_m, JointKind(arm.links[joint].joint.kind).unit


def gain(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """Ports of other areas. Flow and speed are in proportion to them where forces are as before."""
    joint, direction = _choose(random, arm), int(random.choice((-1, 0, 1)))
    change = size * random.uniform(0.15, 0.30)
    ratio = 1.0 + change if random.random() < 0.3 else 1.0 - change
    sides = [side(direction)] if direction else [0, 1]

    def apply(of: Arm) -> Arm:
        conductance = np.array(of.quantities.valve.conductance)
        conductance[joint, sides] *= ratio
        return of.change("valve", conductance=conductance)

    truth = {"speed_ratio": Quantity(ratio, "1"), "direction": Quantity(direction, "sign")}
    return _one("gain", arm, joint, "command", truth, "worn or clogged ports", apply)


def delay(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """The driver takes commands over later."""
    joint, added_s = _choose(random, arm), size * random.uniform(0.08, 0.22)

    def apply(of: Arm) -> Arm:
        present = of.quantities.valve.dead_time_s
        return of.change("valve", dead_time_s=with_value(present, joint, present[joint] + added_s))

    truth = {"added_delay": Quantity(added_s, "s")}
    return _one("delay", arm, joint, "command", truth, "slow bus to the driver", apply)


def lag(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """A slower spool."""
    joint, added_s = _choose(random, arm), size * random.uniform(0.12, 0.30)

    def apply(of: Arm) -> Arm:
        present = of.quantities.valve.time_constant_s
        return of.change("valve", time_constant_s=with_value(present, joint, present[joint] + added_s))

    truth = {"added_time_constant": Quantity(added_s, "s")}
    return _one("lag", arm, joint, "command_history", truth, "sluggish spool", apply)


def flow_coupling(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """A pump that delivers less: joints starve while others draw."""
    loss = size * random.uniform(0.25, 0.45)

    def apply(of: Arm) -> Arm:
        return of.change("supply", flow_m3_s=of.quantities.supply.flow_m3_s * (1.0 - loss))

    on = tuple(f"command:{name}" for name in _joints(arm))
    return _all("flow_coupling", arm, on, {}, "worn pump", apply)


def load(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """A weight at the tip, in proportion to the arm's; felt by joints whose axis lies across gravity."""
    payload = size * random.uniform(0.15, 0.35) * sum(link.mass_kg for link in arm.links[1:])

    def apply(of: Arm) -> Arm:
        return replace(of, payload_kg=of.payload_kg + payload)

    felt = tuple(link.joint.name for link in arm.links if link.axis[2] == 0.0 and link.axis[0] == 0.0)
    on = tuple(f"position:{name}" for name in felt)
    truth = {"payload": Quantity(payload, "kg")}
    return Effect("load", "load", felt or _joints(arm), on, truth, "payload at the tip", apply)


def thermal_drift(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """Oil that is cold at the start, so that ports pass less."""
    cold_K, warm_up_s = 25.0 * size * random.uniform(0.7, 1.2), random.uniform(100.0, 240.0)

    def apply(of: Arm) -> Arm:
        return of.change("supply", cold_K=cold_K, warm_up_s=warm_up_s)

    return _all("thermal_drift", arm, ("time_since_start",), {}, "cold oil", apply)


def supply_variation(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """A set pressure that wanders; flow goes with its root."""
    std, correlation_s = size * random.uniform(0.15, 0.30), random.uniform(4.0, 15.0)

    def apply(of: Arm) -> Arm:
        return of.change("supply", wander_std=std, wander_correlation_s=correlation_s)

    truth = {"correlation_time": Quantity(correlation_s, "s")}
    return _all("supply_variation", arm, ("latent",), truth, "hunting pump controller", apply)


def leakage(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """Oil past the piston of a joint that carries weight."""
    carrying = [k for k, link in enumerate(arm.links) if link.axis[1] == 1.0] or [0]
    joint = int(random.choice(carrying))
    factor = size * random.uniform(60.0, 200.0)

    def apply(of: Arm) -> Arm:
        present = of.quantities.cylinder.leakage_m3_s_Pa
        return of.change("cylinder", leakage_m3_s_Pa=with_value(present, joint, present[joint] * factor))

    return _one("leakage", arm, joint, "zero_command", {}, "worn piston seal", apply)


def backlash(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """Play of the pin between rod and link."""
    joint = _choose(random, arm)
    span = float(arm.specification.upper[joint] - arm.specification.lower[joint])
    width, (lever, unit) = size * random.uniform(0.015, 0.04) * span, _joint_unit(arm, joint)

    def apply(of: Arm) -> Arm:
        return of.change("cylinder", play_m=with_value(of.quantities.cylinder.play_m, joint, width * lever))

    return _one("backlash", arm, joint, "reversal", {"width": Quantity(width, unit)}, "worn pin", apply)


def stiction(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """Silt holds a spool that was closed for long."""
    joint, extra_s, rest_s = _choose(random, arm), size * random.uniform(0.15, 0.35), random.uniform(0.3, 1.0)

    def apply(of: Arm) -> Arm:
        valve = of.quantities.valve
        return of.change(
            "valve",
            mean_extra_time_s=with_value(valve.mean_extra_time_s, joint, extra_s),
            rest_threshold_s=with_value(valve.rest_threshold_s, joint, rest_s),
        )

    truth = {"mean_extra_time": Quantity(extra_s, "s"), "rest_threshold": Quantity(rest_s, "s")}
    return _one("stiction", arm, joint, "rest_time", truth, "silt in the valve", apply)


def end_cushion(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """An outlet that is throttled before one end."""
    joint, sign = _choose(random, arm), choose_sign(random)
    span = float(arm.specification.upper[joint] - arm.specification.lower[joint])
    zone, share = min(size * random.uniform(0.1, 0.2), 0.5) * span, random.uniform(0.1, 0.3) ** size
    lever, unit = _joint_unit(arm, joint)

    def apply(of: Arm) -> Arm:
        cylinder, place = of.quantities.cylinder, (joint, side(sign))
        return of.change(
            "cylinder",
            cushion_m=with_value(cylinder.cushion_m, place, zone * lever),
            cushion_share=with_value(cylinder.cushion_share, place, share),
        )

    truth = {"zone_length": Quantity(zone, unit), "side": Quantity(sign, "sign")}
    return _one("end_cushion", arm, joint, "position", truth, "damaged cushion", apply)


def sensor_bias(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """Another offset or scale of one encoder."""
    joint, sign = _choose(random, arm), choose_sign(random)
    span = float(arm.specification.upper[joint] - arm.specification.lower[joint])
    is_offset = random.random() < 0.4
    offset = sign * size * random.uniform(0.02, 0.04) * span * is_offset
    scale = 1.0 + sign * size * random.uniform(0.05, 0.10) * (not is_offset)

    def apply(of: Arm) -> Arm:
        encoder = of.quantities.encoder
        return of.change(
            "encoder",
            offset_rad=with_value(encoder.offset_rad, joint, offset),
            scale=with_value(encoder.scale, joint, scale),
        )

    truth = {"offset": Quantity(offset, _joint_unit(arm, joint)[1]), "scale": Quantity(scale, "1")}
    return _one("sensor_bias", arm, joint, "position", truth, "encoder remounted", apply)


def timing(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """Readings that are old when they are stamped."""
    latency_s = size * random.uniform(0.08, 0.20)

    def apply(of: Arm) -> Arm:
        return of.change("encoder", latency_s=latency_s, latency_jitter_s=min(0.01, latency_s))

    return _all("timing", arm, ("clock",), {"latency": Quantity(latency_s, "s")}, "late encoder bus", apply)


def oscillation(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """Air in one joint's oil: a soft cylinder that hardly damps."""
    joint, softer = _choose(random, arm), 1.0 + size * random.uniform(5.0, 15.0)

    def apply(of: Arm) -> Arm:
        modulus, viscous = of.quantities.supply.modulus_Pa, of.quantities.cylinder.viscous_N_s_m
        soft = of.change("supply", modulus_Pa=with_value(modulus, joint, modulus[joint] / softer))
        return soft.change("cylinder", viscous_N_s_m=with_value(viscous, joint, viscous[joint] / softer))

    return _one("oscillation", arm, joint, "time_since_stop", {}, "air in the oil", apply)


def pull(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """A valve that closes a little while another joint's is driven beyond half."""
    joint, source = _choose_two(random, arm)
    loss = size * random.uniform(0.2, 0.4)

    def apply(of: Arm) -> Arm:
        return of.change("odd", pull=with_value(of.quantities.odd.pull, (joint, source), loss))

    return _other("pull", arm, joint, f"command:{_joints(arm)[source]}", "solenoids share a ground", apply)


def hold_boost(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """A valve that opens farther once a direction has been held for some seconds."""
    joint, boost, hold_s = _choose(random, arm), size * random.uniform(0.3, 0.6), random.uniform(0.8, 1.6)

    def apply(of: Arm) -> Arm:
        return of.change(
            "odd", hold_boost=with_value(of.quantities.odd.hold_boost, joint, boost), hold_s=hold_s
        )

    return _other("hold_boost", arm, joint, f"hold_time:{_joints(arm)[joint]}", "regeneration cuts in", apply)


def lockout(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """A driver that shuts the valve for a while when the command's sign is reversed."""
    joint, lockout_s = _choose(random, arm), size * random.uniform(0.2, 0.5)

    def apply(of: Arm) -> Arm:
        return of.change("odd", lockout_s=with_value(of.quantities.odd.lockout_s, joint, lockout_s))

    return _other(
        "lockout", arm, joint, f"reversal:{_joints(arm)[joint]}", "reversal guard in the driver", apply
    )


def coil_heat(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """A coil that weakens while it is driven much."""
    joint, loss, heat_s = _choose(random, arm), size * random.uniform(0.4, 0.7), random.uniform(10.0, 40.0)

    def apply(of: Arm) -> Arm:
        return of.change("odd", heat_loss=with_value(of.quantities.odd.heat_loss, joint, loss), heat_s=heat_s)

    return _other("coil_heat", arm, joint, f"activity:{_joints(arm)[joint]}", "hot coil", apply)


def kink(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """A hose that bends shut while another joint is in the far part of its range."""
    joint, source = _choose_two(random, arm)
    loss, share = size * random.uniform(0.25, 0.5), random.uniform(0.5, 0.75)
    lower, upper = arm.specification.lower[source], arm.specification.upper[source]
    place = float(lower + share * (upper - lower))

    def apply(of: Arm) -> Arm:
        odd = of.quantities.odd
        return of.change(
            "odd",
            kink_loss=with_value(odd.kink_loss, (joint, source), loss),
            kink_at=with_value(odd.kink_at, source, place),
        )

    return _other("kink", arm, joint, f"position:{_joints(arm)[source]}", "kinked hose", apply)


def block(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """A particle that closes most of one joint's ports in episodes that nothing foretells."""
    joint, loss = _choose(random, arm), size * random.uniform(0.3, 0.5)
    share, mean_s = random.uniform(0.1, 0.3), random.uniform(5.0, 20.0)

    def apply(of: Arm) -> Arm:
        present = of.quantities.odd.block_loss
        return of.change(
            "odd", block_loss=with_value(present, joint, loss), block_share=share, block_s=mean_s
        )

    return _other("block", arm, joint, "random", "particle in a port", apply)


def timer(random: np.random.Generator, arm: Arm, size: float) -> Effect:
    """A bypass that a clock opens."""
    joint, loss, period_s = _choose(random, arm), size * random.uniform(0.2, 0.4), random.uniform(30.0, 60.0)

    def apply(of: Arm) -> Arm:
        present = of.quantities.odd.timer_loss
        return of.change("odd", timer_loss=with_value(present, joint, loss), timer_s=period_s)

    return _other("timer", arm, joint, "absolute_time", "timer opens a bypass", apply)


INSIDE: dict[str, tuple[Draw, float]] = {
    "gain": (gain, 2.5),  # a quarter of the area is left
    "delay": (delay, 2.5),
    "lag": (lag, 3.0),
    "flow_coupling": (flow_coupling, 1.6),  # a quarter of the flow is left
    "load": (load, 2.0),
    "thermal_drift": (thermal_drift, 2.0),  # 60 K
    "supply_variation": (supply_variation, 1.5),
    "leakage": (leakage, 3.0),
    "backlash": (backlash, 2.5),  # a tenth of the range
    "stiction": (stiction, 3.0),
    "end_cushion": (end_cushion, 2.5),
    "sensor_bias": (sensor_bias, 2.5),
    "timing": (timing, 2.0),
    "oscillation": (oscillation, 3.0),
}
"""By family of the contract, with the largest size."""

OUTSIDE: dict[str, tuple[Draw, float]] = {
    "pull": (pull, 2.0),
    "hold_boost": (hold_boost, 2.0),
    "lockout": (lockout, 2.0),
    "coil_heat": (coil_heat, 1.3),
    "kink": (kink, 1.8),
    "block": (block, 1.8),
    "timer": (timer, 2.0),
}
"""That no family describes, with the largest size."""

KINDS = INSIDE | OUTSIDE
LARGEST_SIZE = {kind: largest for kind, (_, largest) in KINDS.items()}


def draw(kind: str, seed: int, arm: Arm, size: float) -> Effect:
    """An effect of one kind, drawn by seed.

    Raises:
        InputError: No such kind, or a size that is not within its bounds.
    """
    if kind not in KINDS or not 0.0 < size <= KINDS[kind][1]:
        raise InputError(
            f"effect {kind!r} of size {size}: choose one of {', '.join(KINDS)} and a size it can have"
        )
    return KINDS[kind][0](np.random.default_rng(seed), arm, size)
