"""The compiled loop over the substeps of one control period."""

import numpy as np

from benchmarks.closed_loop.kinematic.command_path import receive
from benchmarks.closed_loop.kinematic.motion import move
from benchmarks.closed_loop.kinematic.speed import ask_for_speed, remember_activity, vary_process
from pipeline.plant.compiled import compiled

SUBSTEP_S = 0.0025
"""Commands arrive at the begin of substeps. As dead times are spread over 12 of them (`DEAD_TIME_JITTER_S`), that
rounding does not show in their mean differences."""


@compiled
def advance(
    quantity_record: np.recarray,
    state_record: np.recarray,
    commands: np.ndarray,
    arrival_s: np.ndarray,
    extra_share: np.ndarray,
    process_draw: np.ndarray,
    period: int,
    n_substep: int,
    start_clock_s: float,
    path_rad: np.ndarray,
) -> None:
    """Run one control period.

    Args:
        quantity_record: `Quantities` as one record.
        state_record: `State` as one record, changed in place.
        commands: (T, n) of the session; rows up to `period` are known.
        arrival_s: (T, n) when they reach the valves, since the session's start.
        extra_share: (T, n) of the mean extra time, for starts that stick.
        process_draw: (T, N_SHARED + n) standard normal.
        period: Number of the control period.
        n_substep: Substeps in it.
        start_clock_s: Of the wall clock at the session's start.
        path_rad: (T * n_substep + 1, n) true joint angles; the rows behind `period * n_substep` are written.
    """
    quantities, state = quantity_record[0], state_record[0]
    speed, motion, dependences = quantities.speed, quantities.motion, quantities.dependences
    n = commands.shape[1]
    wanted_rad_s, levers = np.empty(n), np.empty(n)
    vary_process(speed, state, process_draw[period], n_substep * SUBSTEP_S)
    for substep in range(n_substep):
        row = period * n_substep + substep
        time_s = row * SUBSTEP_S
        receive(
            quantities.command_path,
            dependences.lockout_s,
            state,
            commands,
            arrival_s,
            extra_share[period],
            period,
            time_s,
            SUBSTEP_S,
        )
        remember_activity(dependences, state, SUBSTEP_S)
        ask_for_speed(
            speed,
            dependences,
            state,
            motion.lower_rad,
            motion.upper_rad,
            time_s,
            start_clock_s + time_s,
            wanted_rad_s,
            levers,
        )
        move(motion, state, wanted_rad_s, SUBSTEP_S)
        path_rad[row + 1] = state.link_rad
