"""From the speed that is asked for to the joint's angle: lags, resonance, leak, stops and play."""

import numpy as np

from benchmarks.closed_loop.kinematic.machine import Motion
from benchmarks.closed_loop.kinematic.state import State
from pipeline.plant.compiled import compiled


@compiled
def approached(present: float, wanted: float, time_constant_s: float, dt_s: float) -> float:
    """A system of first order after `dt_s` of a held input; without time constant the input itself."""
    if time_constant_s <= 0.0:
        return wanted
    return present + (1.0 - np.exp(-dt_s / time_constant_s)) * (wanted - present)


@compiled
def _ring(motion: Motion, state: State, joint: int, dt_s: float) -> None:
    """A lightly damped system of second order after `dt_s` of a held input, in closed form.

    ẍ = ω² (u - x) - 2 ζ ω ẋ, whose deviation from u decays as exp(-ζωt), turning with ω √(1 - ζ²).
    """
    speed = state.lagged_rad_s[joint]
    if motion.resonance_Hz[joint] <= 0.0:
        state.ringing_rad_s[joint], state.ringing_rad_s2[joint] = speed, 0.0
        return
    omega, damping = 2.0 * np.pi * motion.resonance_Hz[joint], motion.damping_ratio[joint]
    turn = omega * np.sqrt(1.0 - damping * damping)
    decay, cosine, sine = np.exp(-damping * omega * dt_s), np.cos(turn * dt_s), np.sin(turn * dt_s)
    deviation, rate = state.ringing_rad_s[joint] - speed, state.ringing_rad_s2[joint]
    quadrature = (rate + damping * omega * deviation) / turn
    state.ringing_rad_s[joint] = speed + decay * (deviation * cosine + quadrature * sine)
    state.ringing_rad_s2[joint] = decay * (
        rate * cosine - (omega * omega * deviation + damping * omega * rate) / turn * sine
    )


@compiled
def move(motion: Motion, state: State, wanted_rad_s: np.ndarray, dt_s: float) -> None:
    """Advance all joints by one substep towards the speeds that are asked for, (n,)."""
    for j in range(wanted_rad_s.size):
        wanted, present = wanted_rad_s[j], state.drive_rad_s[j]
        grows = wanted * present >= 0.0 and abs(wanted) > abs(present)
        time_constant_s = motion.rise_time_constant_s[j] if grows else motion.fall_time_constant_s[j]
        state.drive_rad_s[j] = approached(present, wanted, time_constant_s, dt_s)
        state.lagged_rad_s[j] = approached(
            state.lagged_rad_s[j], state.drive_rad_s[j], motion.added_time_constant_s[j], dt_s
        )
        _ring(motion, state, j, dt_s)
        speed = state.ringing_rad_s[j]
        if state.arrived[j] == 0.0:
            speed += motion.sag_rate_rad_s[j]
        before = state.drive_rad[j]
        state.drive_rad[j] = min(max(before + dt_s * speed, motion.lower_rad[j]), motion.upper_rad[j])
        if state.drive_rad[j] != before + dt_s * speed:  # a stop
            state.drive_rad_s[j] = state.lagged_rad_s[j] = 0.0
            state.ringing_rad_s[j] = state.ringing_rad_s2[j] = 0.0
        state.travel_rad[j] += abs(state.drive_rad[j] - before)
        half_play = 0.5 * motion.play_rad[j]
        low, high = state.drive_rad[j] - half_play, state.drive_rad[j] + half_play
        state.link_rad[j] = min(max(state.link_rad[j], low), high)
