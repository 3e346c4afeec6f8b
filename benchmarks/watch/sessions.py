"""Sessions of a machine, sound and changed, and their statistics."""

import tempfile
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.closed_loop import kinds
from benchmarks.closed_loop.machines import FIRST_DAY, variant
from benchmarks.closed_loop.sessions import PROFILE, Session, machine, trajectories
from benchmarks.closed_loop.simulators import SIMULATORS
from pipeline.configuration.load import load_section
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.watch.nominal_sessions import LearningSettings, learn_nominal

MINUTES, N_NOMINAL, N_SOUND, N_CHANGED = 6.0, 10, 14, 2
OPERATORS = 3
SIZE = 0.1**0.5  # of the largest: the middle of what the blind benchmark draws, on its logarithmic scale
NOMINAL, SOUND, OTHER = "nominal", "sound", "other operator"


class Planned(NamedTuple):
    """A session with its label, and the joints that its machine's effect is on."""

    label: str
    session: Session
    joints: tuple[str, ...] = ()


def plan(simulator: str, number: int) -> Iterator[Planned]:
    """Sessions of one machine: sound ones by three operators, and two with each family's effect."""
    of = variant(SIMULATORS[simulator], number)
    random = np.random.default_rng([number, 7])
    styles = [of.style_seed, *(int(random.integers(2**31)) for _ in range(OPERATORS - 1))]
    day = iter(range(10**6))

    def session(parameters: object, style: int) -> Session:
        seed, start = int(random.integers(2**31)), FIRST_DAY + timedelta(days=next(day))
        return Session(of.simulator, parameters, (), style, seed, MINUTES, start)

    for label, n in ((NOMINAL, N_NOMINAL), (SOUND, N_SOUND)):
        for index in range(n):
            yield Planned(label, session(of.parameters, styles[index % OPERATORS]))
    for _ in range(OPERATORS):
        yield Planned(OTHER, session(of.parameters, int(random.integers(2**31))))
    for kind in kinds.SETS_IN:
        size = of.simulator.largest_size[kind] * SIZE
        effect = of.simulator.draw_effect(kind, int(random.integers(2**31)), of, size)
        for index in range(N_CHANGED):
            changed = session(effect.apply(of.parameters), styles[index % OPERATORS])
            yield Planned(kind, changed, effect.joints)


def record(folder: Path, simulator: str, number: int) -> None:
    """Write the statistics of a machine's sessions."""
    planned = list(plan(simulator, number))
    sessions = [trajectories(of.session) for of in planned]
    settings = LearningSettings(
        machine(),
        load_section("close_loop", CloseLoopConfig, PROFILE),
        load_section("identify", IdentifyConfig, PROFILE),
    )
    with tempfile.TemporaryDirectory() as state:
        nominal = learn_nominal(Path(state), "", sessions[:N_NOMINAL], settings, print)
    later = [nominal.statistics_of([session])[0] for session in sessions[N_NOMINAL:]]
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(
        folder / f"{simulator}_{number}.npz",
        statistics=np.concatenate([nominal.rows.statistics, later]),
        label=np.array([of.label for of in planned]),
    )
