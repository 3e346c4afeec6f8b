"""A machine's behaviour, simulated without process variation: speeds, rise times, sag, ringing.

Used to state the truth of an effect in the terms of the contract, and by the tests.
"""

from typing import NamedTuple

import numpy as np

from pipeline.plant.parameters import NEGATIVE, POSITIVE, Parameters
from pipeline.plant.physics.kinematics import configuration
from pipeline.plant.simulator import Plant

SETTLE_S = 1.0  # rest before a manoeuvre
START_SHARE = 0.15  # of the joint's range between the start and the limit behind it
AHEAD_SHARE = 0.12  # of the range before the limit ahead: there the measurement ends
MIDDLE_RAD = (0.0, 0.75, -1.4, -0.9)  # the other joints of the E10
BOOM, ARM = 1, 2
WORKING_RADII_M, WORKING_HEIGHTS_M = (1.2, 1.7, 2.2), (0.3, 0.9, 1.5)  # of the tip, spread over the workspace
RUN_UP_RAD = 0.35  # way of a joint before it stops in a working configuration
PASSAGE_S = 1.6  # of full command through a working configuration
SAG_S = 4.0  # short, so that the joint hardly leaves its position
FINE_PERIOD_S = 0.010  # control period of manoeuvres, for the sake of time resolution


def in_the_air(parameters: Parameters) -> Parameters:
    """The same machine on a stand, where no manoeuvre ends at the ground or the base."""
    return parameters.change("contact", floor_m=-np.inf, base_radius_m=0.0)


def without_variation(parameters: Parameters) -> Parameters:
    """The same machine in the air without process variation, at a fine control period and fixed temperature."""
    parameters = in_the_air(parameters)
    parameters = parameters.change("pilot", noise_std=0.0, controller_cycle_s=parameters.numerics.substep_s)
    parameters = parameters.change("supply", ripple_std=0.0, relief_wander_std=0.0)
    parameters = parameters.change("spool", silt_spread=0.0)
    parameters = parameters.change("sensor", noise_std_rad=0.0, stamp_jitter_s=0.0, command_jitter_s=0.0)
    parameters = parameters.change("oil", heat_capacity_J_K=1.0e12)
    return parameters.change("numerics", control_period_s=FINE_PERIOD_S)


class Response(NamedTuple):
    """Angles and speeds of one joint after a manoeuvre begins; times from the command's onset."""

    time_s: np.ndarray  # (T,)
    angle_rad: np.ndarray  # (T,)
    speed_rad_s: np.ndarray  # (T,)


def respond(
    parameters: Parameters,
    joint: int,
    direction: int,
    duration_s: float,
    start: np.ndarray | None = None,
    others: np.ndarray | None = None,
    rest_s: float = SETTLE_S,
) -> Response:
    """Hold one joint's command after a rest.

    Args:
        parameters: the machine; process variation is taken out.
        joint: which.
        direction: -1 or 1.
        duration_s: how long the command is held.
        start: configuration (n,), rad; by default the middle, with room for the motion.
        others: commands (n,) of all joints, of which the joint's own is replaced; zero by default.
        rest_s: rest before.
    """
    silent = without_variation(parameters)
    begin = start_for(parameters, joint, direction) if start is None else start
    plant = Plant(silent, 0, begin)
    command = np.zeros(plant.n_joint) if others is None else np.array(others)
    command[joint] = direction
    plant.run(np.zeros((round(rest_s / FINE_PERIOD_S), plant.n_joint)))
    angle = plant.run(np.tile(command, (round(duration_s / FINE_PERIOD_S), 1))).angle_rad[:, joint]
    time = FINE_PERIOD_S * (1.0 + np.arange(angle.size))
    return Response(time, angle, np.gradient(angle, FINE_PERIOD_S))


def start_for(parameters: Parameters, joint: int, direction: int) -> np.ndarray:
    """The middle configuration, with `joint` near the limit behind the motion."""
    linkage = parameters.linkage
    start = np.array(MIDDLE_RAD)
    span = linkage.upper_rad[joint] - linkage.lower_rad[joint]
    behind = linkage.lower_rad[joint] if direction > 0 else linkage.upper_rad[joint]
    start[joint] = behind + direction * START_SHARE * span
    return start


def full_speed(
    parameters: Parameters,
    joint: int,
    direction: int,
    others: np.ndarray | None = None,
    hold_s: float = 2.5,
    start: np.ndarray | None = None,
) -> float:
    """Mean speed under full command from 1 s to `hold_s` or near the limit; rad/s, positive; nan at the limit."""
    response = respond(parameters, joint, direction, hold_s, start, others=others)
    linkage = parameters.linkage
    margin = AHEAD_SHARE * (linkage.upper_rad[joint] - linkage.lower_rad[joint])
    inside = (response.angle_rad < linkage.upper_rad[joint] - margin) | (direction < 0)
    inside &= (response.angle_rad > linkage.lower_rad[joint] + margin) | (direction > 0)
    used = inside & (response.time_s >= 1.0)
    return float(direction * np.mean(response.speed_rad_s[used])) if used.any() else float("nan")


def full_speeds(parameters: Parameters) -> np.ndarray:
    """`full_speed` of every joint and direction, (n, 2)."""
    n = parameters.linkage.lower_rad.size
    return np.array([[full_speed(parameters, j, -1), full_speed(parameters, j, 1)] for j in range(n)])


def start_time(parameters: Parameters, joint: int, direction: int, rest_s: float = SETTLE_S) -> float:
    """From command to a tenth of full speed, s."""
    return _crossing(parameters, joint, direction, 0.1, rest_s)


def rise_time(parameters: Parameters, joint: int, direction: int) -> float:
    """From command to nine tenths of the speed that is reached at 1.5 s, s."""
    return _crossing(parameters, joint, direction, 0.9, SETTLE_S)


def _crossing(parameters: Parameters, joint: int, direction: int, share: float, rest_s: float) -> float:
    response = respond(parameters, joint, direction, 1.6, rest_s=rest_s)
    speed = direction * response.speed_rad_s
    settled = np.mean(speed[response.time_s >= 1.4])
    return float(response.time_s[np.argmax(speed >= share * settled)])


def sag_rate(
    parameters: Parameters, joint: int, duration_s: float = 10.0, start: np.ndarray | None = None
) -> float:
    """Speed at zero command after the first second, from `start` (n,), rad, or the middle configuration; rad/s."""
    plant = Plant(without_variation(parameters), 0, np.array(MIDDLE_RAD) if start is None else start)
    angle = plant.run(np.zeros((round(duration_s / FINE_PERIOD_S), plant.n_joint))).angle_rad[:, joint]
    n_skip = round(SETTLE_S / FINE_PERIOD_S)
    return float((angle[-1] - angle[n_skip]) / (FINE_PERIOD_S * (angle.size - 1 - n_skip)))


def working_configurations(parameters: Parameters) -> list[np.ndarray]:
    """Configurations (n,), rad, with the chisel straight down at places over the workspace, within the joint limits."""
    linkage = parameters.linkage
    reached = [
        configuration(np.array([radius, height]), pitch=0.0, yaw=MIDDLE_RAD[0])
        for radius in WORKING_RADII_M
        for height in WORKING_HEIGHTS_M
    ]
    return [
        q
        for q in reached
        if q is not None and np.all(q > linkage.lower_rad) and np.all(q < linkage.upper_rad)
    ]


def mean_sag_rate(parameters: Parameters, joint: int) -> float:
    """Mean of `sag_rate` over the configurations that the arm works in, rad/s."""
    starts = working_configurations(parameters)
    return float(np.mean([sag_rate(parameters, joint, SAG_S, start) for start in starts]))


def mean_full_speed(parameters: Parameters, joint: int, direction: int) -> float:
    """Mean of `full_speed` through the working configurations, as gravity depends on them; rad/s, positive."""
    lower, upper = parameters.linkage.lower_rad[joint], parameters.linkage.upper_rad[joint]
    found = []
    for start in working_configurations(parameters):
        speed = (
            full_speed(parameters, joint, -direction) * SETTLE_S
        )  # start back by the distance of the skipped time
        start[joint] = np.clip(start[joint] - direction * speed, lower, upper)
        found.append(full_speed(parameters, joint, direction, hold_s=PASSAGE_S, start=start))
    return float(np.nanmean(found))


class Ringing(NamedTuple):
    """A decaying oscillation."""

    frequency_Hz: float
    damping_ratio: float


def mean_ringing(parameters: Parameters, joint: int, direction: int) -> Ringing | None:
    """Mean of `ringing` over the working configurations, as inertia depends on them; None if it never rings."""
    found = []
    for start in working_configurations(parameters):
        lower, upper = parameters.linkage.lower_rad[joint], parameters.linkage.upper_rad[joint]
        start[joint] = np.clip(start[joint] - direction * RUN_UP_RAD, lower, upper)
        found.append(ringing(parameters, joint, direction, start))
    heard = [one for one in found if one is not None]
    return Ringing(*np.mean(heard, axis=0).tolist()) if heard else None


def ringing(
    parameters: Parameters, joint: int, direction: int, start: np.ndarray | None = None
) -> Ringing | None:
    """Oscillation of the speed after a full-speed stop, by peaks and logarithmic decrement; None if none."""
    begin = start_for(parameters, joint, direction) if start is None else start
    plant = Plant(without_variation(parameters), 0, begin)
    command = np.zeros(plant.n_joint)
    command[joint] = direction
    n_move = round(1.5 / FINE_PERIOD_S)
    plant.run(np.tile(command, (n_move, 1)))
    angle = plant.run(np.zeros((n_move, plant.n_joint))).angle_rad[:, joint]
    speed = np.gradient(angle, FINE_PERIOD_S)[round(0.25 / FINE_PERIOD_S) :]
    turning = np.flatnonzero((speed[1:-1] - speed[:-2]) * (speed[2:] - speed[1:-1]) < 0.0) + 1
    threshold = 0.01 * np.max(np.abs(np.gradient(angle, FINE_PERIOD_S)))
    swings = np.abs(np.diff(speed[turning]))
    kept = swings > threshold
    n_swing = int(np.argmin(kept)) if not kept.all() else swings.size
    if n_swing < 2:
        return None
    half_period = np.mean(np.diff(turning[: n_swing + 1])) * FINE_PERIOD_S
    decrement = np.log(swings[0] / swings[n_swing - 1]) / (n_swing - 1) / np.pi
    return Ringing(0.5 / float(half_period), float(decrement / np.hypot(1.0, decrement)))


def side(direction: int) -> int:
    """Index of a direction -1 or 1 in arrays of shape (n, 2)."""
    return POSITIVE if direction > 0 else NEGATIVE
