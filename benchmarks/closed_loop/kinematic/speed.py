"""The speed that the valves ask for: a product of factors on each joint's full speed."""

import numpy as np

from benchmarks.closed_loop.kinematic.machine import (
    LARGEST_ACTIVITY,
    LEAST_TRAVEL_RATIO,
    NEGATIVE,
    POSITION_RAMP_RAD,
    POSITIVE,
    TYPICAL_ACTIVITY,
    Dependences,
    Speed,
)
from benchmarks.closed_loop.kinematic.state import N_SHARED, SLOW, SUPPLY, State
from pipeline.plant.compiled import compiled

LINK_LENGTH_M = (1.35, 0.80, 0.65)
"""Boom, arm, hammer to the chisel's tip (contract, section 1); all horizontal at zero angles."""


@compiled
def read_levers(position_rad: np.ndarray, levers: np.ndarray) -> None:
    """Horizontal distance of the chisel's tip from each joint's axis, as share of the longest possible, 1.

    The moment of a weight at the tip; negative where the tip has passed below the joint towards the cab. Swing: 0.

    Args:
        position_rad: Swing, boom, arm, bucket, (4,).
        levers: Written, (4,).
    """
    distance_m = length_m = 0.0
    angle = position_rad[1] + position_rad[2] + position_rad[3]
    for link in range(2, -1, -1):  # from the tip inwards; link k turns about joint k + 1
        distance_m += LINK_LENGTH_M[link] * np.cos(angle)
        length_m += LINK_LENGTH_M[link]
        levers[link + 1] = distance_m / length_m
        angle -= position_rad[link + 1]
    levers[0] = 0.0


@compiled
def ask_for_speed(
    speed: Speed,
    dependences: Dependences,
    state: State,
    lower_rad: np.ndarray,
    upper_rad: np.ndarray,
    time_s: float,
    clock_s: float,
    wanted_rad_s: np.ndarray,
    levers: np.ndarray,
) -> None:
    """Write the speeds that the valves ask for.

    Args:
        speed: Of the machine.
        dependences: Of the machine.
        state: Present.
        lower_rad: (n,) stops, before which cushions lie.
        upper_rad: (n,).
        time_s: Since the session's start.
        clock_s: Of the wall clock.
        wanted_rad_s: Written, (n,).
        levers: Written, (n,); see `read_levers`.
    """
    n = state.valve.size
    demand = 0.0
    for j in range(n):
        demand += abs(state.valve[j])
    common = 1.0 if demand <= speed.capacity else speed.capacity / demand
    common *= 1.0 - speed.cold_loss * np.exp(-time_s / speed.warm_up_s)
    common *= np.exp(speed.slow_std * state.process[SLOW] + speed.supply_std * state.process[SUPPLY])
    common *= 1.0 - dependences.activity_loss * min(state.activity[0], LARGEST_ACTIVITY)
    read_levers(state.drive_rad, levers)
    for j in range(n):
        valve = state.valve[j]
        if valve == 0.0:
            wanted_rad_s[j] = 0.0
            continue
        sign, side = (1.0, POSITIVE) if valve > 0.0 else (-1.0, NEGATIVE)
        position = state.drive_rad[j]
        factor = common * np.exp(speed.fast_std * state.process[N_SHARED + j])
        factor *= 1.0 + speed.pose_dependence[j] * np.sin(2.0 * position)
        factor *= 1.0 - sign * speed.gravity_loss[j] * levers[j]
        factor *= 1.0 - sign * speed.load_loss[j] * levers[j]
        factor *= 1.0 - speed.coupling_loss * (demand - abs(valve)) / (n - 1)
        zone = speed.cushion_zone_rad[j, side]
        distance = upper_rad[j] - position if side == POSITIVE else position - lower_rad[j]
        if distance < zone:
            least = speed.cushion_ratio[j, side]
            factor *= least + (1.0 - least) * max(distance, 0.0) / zone
        factor *= 1.0 - dependences.hold_loss[j] * (1.0 - np.exp(-state.held_s[j] / dependences.hold_s))
        if state.held_s[j] > dependences.boost_s:
            factor *= 1.0 + dependences.boost[j]
        factor *= max(1.0 - dependences.travel_loss_per_rad[j] * state.travel_rad[j], LEAST_TRAVEL_RATIO)
        if clock_s % dependences.cycle_s < 0.5 * dependences.cycle_s:
            factor *= 1.0 - dependences.cycle_loss[j]
        for i in range(n):
            if state.valve[i] != 0.0:
                factor *= dependences.command_ratio[j, i, POSITIVE if state.valve[i] > 0.0 else NEGATIVE]
            beyond = (state.drive_rad[i] - dependences.position_rad[j, i]) / POSITION_RAMP_RAD
            factor *= 1.0 - dependences.position_loss[j, i] * min(max(beyond, 0.0), 1.0)
        wanted_rad_s[j] = valve * speed.full_speed_rad_s[j, side] * factor


@compiled
def vary_process(speed: Speed, state: State, draw: np.ndarray, dt_s: float) -> None:
    """Advance the Ornstein-Uhlenbeck processes, exactly (Gillespie, Phys. Rev. E 54, 1996), by `dt_s`.

    Args:
        speed: Of the machine, for correlation times.
        state: Changed in place.
        draw: (N_SHARED + n,) standard normal.
        dt_s: Step.
    """
    for k in range(draw.size):
        correlation_s = speed.fast_correlation_s
        if k == SLOW:
            correlation_s = speed.slow_correlation_s
        elif k == SUPPLY:
            correlation_s = speed.supply_correlation_s
        kept = np.exp(-dt_s / correlation_s)
        state.process[k] = kept * state.process[k] + np.sqrt(1.0 - kept * kept) * draw[k]


@compiled
def remember_activity(dependences: Dependences, state: State, dt_s: float) -> None:
    """Average how much is being commanded over the recent past."""
    present = 0.0
    for j in range(state.valve.size):
        present += abs(state.valve[j])
    present /= state.valve.size * TYPICAL_ACTIVITY
    state.activity[0] += (1.0 - np.exp(-dt_s / dependences.activity_s)) * (present - state.activity[0])
