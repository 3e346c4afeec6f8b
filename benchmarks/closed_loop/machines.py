"""The machines of the benchmark: every number is one of the class, all constants drawn, with an operator of its own."""

from dataclasses import dataclass
from datetime import datetime
from functools import cache

import numpy as np

from benchmarks.closed_loop.simulator import Machine, Simulator

DESIGN = 5_2024  # seeds everything that belongs to variants; cases have seeds of their own
NOMINAL_MINUTES = (12.0, 12.0)
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
    """

    simulator: Simulator
    number: int
    parameters: Machine
    style_seed: int
    session_seeds: tuple[int, ...]

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
    machine_seed, style_seed, *sessions = (
        np.random.SeedSequence([DESIGN, number, *simulator.entropy])
        .generate_state(2 + len(NOMINAL_MINUTES))
        .tolist()
    )
    return Variant(simulator, number, simulator.drawn_machine(machine_seed), style_seed, tuple(sessions))
