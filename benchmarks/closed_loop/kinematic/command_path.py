"""From the stick to the valve: dead time, and starts that stick after a rest."""

import numpy as np

from benchmarks.closed_loop.kinematic.machine import CommandPath
from benchmarks.closed_loop.kinematic.state import State
from pipeline.plant.compiled import compiled

STANDING_RAD_S = 0.01  # a drive that is slower stands


@compiled
def receive(
    path: CommandPath,
    lockout_s: np.ndarray,
    state: State,
    commands: np.ndarray,
    arrival_s: np.ndarray,
    extra_share: np.ndarray,
    period: int,
    time_s: float,
    dt_s: float,
) -> None:
    """Let commands arrive that are due, and hold starts back that stick.

    A start sticks when the valve was closed and the drive stood for longer than the threshold. If the command ends
    before the valve lets go, the rest goes on: the start failed.

    Args:
        path: Of the machine.
        lockout_s: (n,) see `Dependences`.
        state: Changed in place.
        commands: (T, n) of the session so far.
        arrival_s: (T, n) when each of them reaches the valve, since the session's start.
        extra_share: (n,) of the mean extra time, for starts that begin now.
        period: Number of the present control period.
        time_s: Since the session's start.
        dt_s: Of the substep.
    """
    for j in range(state.valve.size):
        before = state.arrived[j]
        while state.arrived_period[j] < period and arrival_s[state.arrived_period[j] + 1, j] <= time_s:
            state.arrived_period[j] += 1
            state.arrived[j] = commands[state.arrived_period[j], j]
        command = state.arrived[j]
        state.held_s[j] = state.held_s[j] + dt_s if command == before else 0.0
        if command != 0.0 and before == 0.0 and state.rest_s[j] > path.rest_threshold_s[j]:
            state.stuck_s[j] = path.mean_extra_time_s[j] * extra_share[j]
        if command * state.sign[j] < 0.0:
            state.locked_s[j] = lockout_s[j]
        if command != 0.0:
            state.sign[j] = np.sign(command)
        state.valve[j] = 0.0 if max(state.stuck_s[j], state.locked_s[j]) > 0.0 else command
        state.stuck_s[j] = max(state.stuck_s[j] - dt_s, 0.0)
        state.locked_s[j] = max(state.locked_s[j] - dt_s, 0.0)
        stands = state.valve[j] == 0.0 and abs(state.drive_rad_s[j]) < STANDING_RAD_S
        state.rest_s[j] = state.rest_s[j] + dt_s if stands else 0.0
