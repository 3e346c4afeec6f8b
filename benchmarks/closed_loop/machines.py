"""The machines of the benchmark: variants of the simulated machine, each with an operator and nominal sessions."""

from dataclasses import dataclass
from datetime import datetime

import numpy as np

from pipeline.plant.parameters import Parameters
from pipeline.plant.simulated import simulated_machine
from pipeline.plant.variants import draw_variant

MACHINE = "bobcat_e10"
N_VARIANT = 8
DESIGN = 5_2024  # seeds everything that belongs to variants; cases have seeds of their own
NOMINAL_MINUTES = (12.0, 12.0)
YARDSTICK_MINUTES = (12.0, 12.0, 12.0)  # sessions that no log shows: what the sound machine's 4 s error is
FIRST_DAY = datetime.fromisoformat("2025-03-03T08:00:00+00:00")


@dataclass(frozen=True)
class Variant:
    """One machine.

    Attributes:
        number: 0 … `N_VARIANT` - 1.
        parameters: Its sound state.
        style_seed: Of the operator who recorded its nominal sessions.
        session_seeds: Of its nominal sessions.
        yardstick_seeds: Of the sessions that the yardstick is.
    """

    number: int
    parameters: Parameters
    style_seed: int
    session_seeds: tuple[int, ...]
    yardstick_seeds: tuple[int, ...]

    @property
    def name(self) -> str:
        """Folder of what belongs to the variant."""
        return f"variant_{self.number}"


def variant(number: int) -> Variant:
    """The variant of that number; always the same."""
    n_nominal = len(NOMINAL_MINUTES)
    n_seed = 2 + n_nominal + len(YARDSTICK_MINUTES)
    machine_seed, style_seed, *sessions = (
        np.random.SeedSequence([DESIGN, number]).generate_state(n_seed).tolist()
    )
    parameters = draw_variant(simulated_machine(MACHINE), machine_seed)
    return Variant(number, parameters, style_seed, tuple(sessions[:n_nominal]), tuple(sessions[n_nominal:]))
