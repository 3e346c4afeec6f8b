"""Figures of the watch: false alarms over a year of sessions, and how soon steps and ramps are told.

    python -m benchmarks.watch record FOLDER --simulator kinematic --number 900
    python -m benchmarks.watch resample FOLDER

`record` simulates sessions of one machine, learns from ten of them, and keeps the statistics of all in
`FOLDER/<simulator>_<number>.npz`. `resample` draws machines' years from these with replacement, as recording each year
would take days: nominal sessions and later ones come from one pool, so that tails beyond the pool are not tried. A
ramp is the step's mean change in growing shares, on top of a sound session.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import numpy as np

from benchmarks.closed_loop import kinds
from benchmarks.closed_loop.machines import FIRST_DAY, variant
from benchmarks.closed_loop.sessions import PROFILE, Session, machine, trajectories
from benchmarks.closed_loop.simulators import SIMULATORS
from pipeline.configuration.load import load_section
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.watch.course import follow
from pipeline.watch.nominal_sessions import LearningSettings, learn_nominal
from pipeline.watch.settings import WatchConfig

MINUTES, N_NOMINAL, N_SOUND, N_CHANGED = 6.0, 10, 14, 2
N_MACHINE, N_SESSION = 60, 250
OPERATORS = 3
SIZE = 0.1**0.5  # of the largest: the middle of what the blind benchmark draws, on its logarithmic scale
REPEATS, BEFORE, RAMP, AFTER = (
    10,
    (5, 40),
    30,
    40,
)  # draws; sessions before a change; to full size; watched since
NOMINAL, SOUND, OTHER = "nominal", "sound", "other operator"


def plan(simulator: str, number: int) -> Iterator[tuple[str, Session]]:
    """Sessions of one machine with their labels: sound ones by three operators, and two with each family's effect."""
    of = variant(SIMULATORS[simulator], number)
    random = np.random.default_rng([number, 7])
    styles = [of.style_seed, *(int(random.integers(2**31)) for _ in range(OPERATORS - 1))]
    day = iter(range(10**6))

    def session(parameters: object, style: int) -> Session:
        seed, start = int(random.integers(2**31)), FIRST_DAY + timedelta(days=next(day))
        return Session(of.simulator, parameters, (), style, seed, MINUTES, start)

    for label, n in ((NOMINAL, N_NOMINAL), (SOUND, N_SOUND)):
        for index in range(n):
            yield label, session(of.parameters, styles[index % OPERATORS])
    for _ in range(OPERATORS):
        yield OTHER, session(of.parameters, int(random.integers(2**31)))
    for kind in kinds.SETS_IN:
        size = of.simulator.largest_size[kind] * SIZE
        effect = of.simulator.draw_effect(kind, int(random.integers(2**31)), of, size)
        for index in range(N_CHANGED):
            yield kind, session(effect.apply(of.parameters), styles[index % OPERATORS])


def record(folder: Path, simulator: str, number: int) -> None:
    """Write the statistics of a machine's sessions."""
    labels, sessions = zip(
        *((label, trajectories(one)) for label, one in plan(simulator, number)), strict=True
    )
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
        label=np.array(labels),
    )


def resample(path: Path) -> None:
    """Print a machine's figures as a row of Markdown, by family on standard error."""
    with np.load(path) as file:
        statistics, label = file["statistics"], file["label"]
    config, random = load_section("watch", WatchConfig, PROFILE), np.random.default_rng(0)
    sound = statistics[np.isin(label, (NOMINAL, SOUND, OTHER))]

    def drawn(n: int) -> np.ndarray:
        return sound[random.integers(len(sound), size=n)]

    alarms = sum(
        bool(follow(drawn(N_NOMINAL), drawn(N_SESSION), [], config).changes) for _ in range(N_MACHINE)
    )
    delays: dict[str, list[list[float]]] = {"step": [], "ramp": []}
    for kind in kinds.SETS_IN:
        changed = statistics[label == kind]
        for course, of in delays.items():
            of.append([_delay(drawn, changed, sound, course, random, config) for _ in range(REPEATS)])
            told = f"told after {np.median(of[-1]):g} sessions, 90 % by {_ninth(of[-1]):g}"
            print(f"{path.stem}, {kind}, {course}: {told}", file=sys.stderr)
    told_late = [f"{np.median(of):g} | {_ninth(of):g}" for of in map(np.concatenate, delays.values())]
    print(f"| {path.stem} | {alarms} of {N_MACHINE} | {' | '.join(told_late)} |")


def _delay(drawn, changed, sound, course, random, config) -> float:  # type: ignore[no-untyped-def]
    """Sessions since a change until it is told, that of the alarm included; infinite if it is not, or before it."""
    before = int(random.integers(*BEFORE))
    series = drawn(before + AFTER)
    own = changed[random.integers(len(changed), size=AFTER)] if course == "step" else changed.mean(axis=0)
    share = np.minimum(np.arange(1, AFTER + 1) / RAMP, 1.0) if course == "ramp" else np.ones(AFTER)
    series[before:] += share[:, None, None] * (own - sound.mean(axis=0))
    changes = follow(drawn(N_NOMINAL), series, [], config).changes
    since = changes[0].alarm - before + 1 if changes else np.inf
    return float(since) if since > 0 else np.inf


def _ninth(delays: object) -> float:
    """The delay that nine of ten do not exceed."""
    return float(np.quantile(np.asarray(delays), 0.9, method="higher"))


def main() -> None:
    parser = argparse.ArgumentParser(prog="watch", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=("record", "resample"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--simulator", choices=SIMULATORS, default="kinematic")
    parser.add_argument("--number", type=int, default=900, help="of the machine")
    arguments = parser.parse_args()
    if arguments.what == "record":
        record(arguments.folder, arguments.simulator, arguments.number)
        return
    print(
        "| machine | sound, but told as changed | step: sessions until told, median | 90 % | ramp: median | 90 % |"
    )
    print("|---|---|---|---|---|---|")
    for path in sorted(arguments.folder.glob("*.npz")):
        resample(path)


if __name__ == "__main__":
    main()
