"""The machines of the benchmark, each with an operator and nominal sessions.

Numbers below `N_VARIANT` are variants of one build: what differs between machines that leave the same works. From there
on every number is a machine of the class whose constants are all drawn (`benchmarks.machine_draws`).
"""

from dataclasses import dataclass
from datetime import datetime
from functools import cache

import numpy as np

from benchmarks.closed_loop.sessions import machine
from benchmarks.closed_loop.simulator import Machine, Simulator

N_VARIANT = 8  # of one build
DESIGN = 5_2024  # seeds everything that belongs to variants; cases have seeds of their own
NOMINAL_MINUTES = (12.0, 12.0)
YARDSTICK_MINUTES = (12.0, 12.0, 12.0)  # sessions that no log shows: what the sound machine's 4 s error is
FIRST_DAY = datetime.fromisoformat("2025-03-03T08:00:00+00:00")


@dataclass(frozen=True, eq=False)
class Variant:
    """One machine.

    Attributes:
        simulator: What it lives in.
        number: 0 or more.
        parameters: Its sound state.
        style_seed: Of the operator who recorded its nominal sessions.
        session_seeds: Of its nominal sessions.
        yardstick_seeds: Of the sessions that the yardstick is.
    """

    simulator: Simulator
    number: int
    parameters: Machine
    style_seed: int
    session_seeds: tuple[int, ...]
    yardstick_seeds: tuple[int, ...]

    @property
    def name(self) -> str:
        """Folder of what belongs to the variant."""
        return variant_name(self.simulator, self.number)


def variant_name(simulator: Simulator, number: int) -> str:
    """Folder of what belongs to a variant; no two simulators share one."""
    return f"{simulator.variant_name}_{number}"


@cache
def variant(simulator: Simulator, number: int) -> Variant:
    """The machine of that number; always the same."""
    n_nominal = len(NOMINAL_MINUTES)
    n_seed = 2 + n_nominal + len(YARDSTICK_MINUTES)
    machine_seed, style_seed, *sessions = (
        np.random.SeedSequence([DESIGN, number, *simulator.entropy]).generate_state(n_seed).tolist()
    )
    if number < N_VARIANT:
        parameters = simulator.sound_machine(machine(), number, machine_seed)
    else:
        parameters = simulator.drawn_machine(machine(), machine_seed)
    nominal, yardstick = tuple(sessions[:n_nominal]), tuple(sessions[n_nominal:])
    return Variant(simulator, number, parameters, style_seed, nominal, yardstick)
