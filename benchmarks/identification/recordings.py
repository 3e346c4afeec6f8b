"""What one drawn machine gives to learn from and to be judged on, and how far it repeats itself."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path

import numpy as np

from benchmarks.closed_loop.machines import FIRST_DAY, Variant, variant
from benchmarks.closed_loop.sessions import Session, machine, trajectories
from benchmarks.closed_loop.simulators import SIMULATORS
from pipeline.files.atomic import write_json
from pipeline.logs.tuples import Trajectory, read_tuples, write_tuples

SESSION_MINUTES = 12.0  # more minutes are more sessions, of which those of fewer minutes are the first
HELD_OUT_MINUTES = (12.0, 12.0)
HELD_OUT, REPLAYED = 1, 2  # besides 0, what is learned from: the seeds of each part of a machine's recordings
FLOOR_HORIZONS = (80, 1000)  # steps


@dataclass(frozen=True)
class Recordings:
    """Of one machine.

    Attributes:
        learning: Nominal sessions, with their split into training and validation.
        held_out: Other nominal sessions.
        floor: By horizon in steps, (n_joint,) rad: the RMSE of one whose prediction is the mean of all replays.
    """

    learning: list[Trajectory]
    held_out: list[Trajectory]
    floor: dict[int, np.ndarray]


def recordings(root: Path, simulator: str, number: int, minutes: float) -> Recordings:
    """Record a machine, or read what was recorded before below `root`."""
    of = variant(SIMULATORS[simulator], number)
    folder = root / "recordings" / of.name
    learning = _sessions(of, 0, durations(minutes))
    held_out = _sessions(of, HELD_OUT, HELD_OUT_MINUTES)
    return Recordings(
        [t for session in learning for t in _kept(folder / "learning", session)],
        [t for session in held_out for t in _kept(folder / "held_out", session)],
        _floor(folder / "floor.json", of, held_out),
    )


def durations(minutes: float) -> list[float]:
    """Of sessions that have so many minutes together."""
    whole, rest = divmod(minutes, SESSION_MINUTES)
    return [SESSION_MINUTES] * int(whole) + [rest] * (rest > 0.0)


def repeatability(of: Variant, session: Session, horizon: int, seed: int) -> tuple[np.ndarray, int]:
    """Squared differences of a session's stretches and their replays, halved.

    If both are the machine's mean and independent chances, half their squared difference is the chances' variance: the
    squared error of the best prediction.

    Args:
        of: The machine.
        session: Of it.
        horizon: Control periods of each stretch; stretches follow one another.
        seed: Of the replays.

    Returns:
        (n_joint,) rad², summed over all steps, and their number.
    """
    log = session.record()
    starts = range(horizon, len(log.commands) - horizon, horizon)
    [again] = of.simulator.replay(of.parameters, log, session.seed, starts, horizon, seed)
    path = log.true_positions
    first = np.array([path[start : start + horizon] - path[start - 1] for start in starts])
    return 0.5 * np.sum((again - first) ** 2, axis=(0, 1)), len(starts) * horizon


def _sessions(of: Variant, part: int, minutes: Sequence[float]) -> list[Session]:
    seeds = np.random.SeedSequence([of.number, part, *of.simulator.entropy]).generate_state(len(minutes))
    days = [FIRST_DAY + timedelta(days=30 * part + number) for number in range(len(minutes))]
    return [
        Session(of.simulator, of.parameters, (), of.style_seed, seed, length, day)
        for seed, length, day in zip(seeds.tolist(), minutes, days, strict=True)
    ]


def _kept(folder: Path, session: Session) -> list[Trajectory]:
    place = folder / f"{session.name}_{session.minutes:g}"
    if not place.exists():
        write_tuples(place / "session.parquet", machine(), trajectories(session))
    return read_tuples(place, machine())


def _floor(path: Path, of: Variant, sessions: Sequence[Session]) -> dict[int, np.ndarray]:
    if not path.exists():
        found = {}
        for horizon in FLOOR_HORIZONS:
            parts = [repeatability(of, session, horizon, REPLAYED) for session in sessions]
            total = np.sum([squares for squares, _ in parts], axis=0) / sum(n for _, n in parts)
            found[str(horizon)] = np.sqrt(total).tolist()
        write_json(path, found)
    return {int(horizon): np.array(values) for horizon, values in json.loads(path.read_text()).items()}
