"""Years of machines, drawn from sessions with replacement: false alarms, delays, what is said of changes, repairs."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.closed_loop import kinds
from benchmarks.closed_loop.sessions import PROFILE, machine
from benchmarks.watch.sessions import N_NOMINAL, NOMINAL, OTHER, SOUND, plan
from pipeline.configuration.load import load_section
from pipeline.watch.change import trend_of
from pipeline.watch.course import follow
from pipeline.watch.settings import WatchConfig

N_MACHINE, N_SESSION = 60, 250
REPEATS, BEFORE, RAMP, AFTER = 10, (5, 40), 30, 40  # draws; sound sessions; to full size; watched since
BROKEN, AFTER_REPAIR = 10, 10  # sessions
COLUMNS = (
    "machine",
    "unchanged, but reported as changed",
    "step: sessions until reported, median",
    "90 %",
    "ramp: median",
    "90 %",
    "joint right, step",
    "ramp",
    "ramp's growth within its interval",
    "repaired: sessions until healthy, median",
    "90 %",
)


class Pool(NamedTuple):
    """What years of a machine are drawn from: statistics of sound sessions, and of those with one effect.

    Attributes:
        sound: (n, n_joint, n_statistic).
        changed: Likewise.
        joints: Indices of those that the effect is on.
    """

    sound: np.ndarray
    changed: np.ndarray
    joints: list[int]

    @property
    def shift(self) -> np.ndarray:
        """(n_joint, n_statistic) mean change."""
        return np.asarray(self.changed.mean(axis=0) - self.sound.mean(axis=0))

    def drawn(self, n: int, random: np.random.Generator) -> np.ndarray:
        """Sound sessions."""
        return self.sound[random.integers(len(self.sound), size=n)]

    def stepped(self, n: int, random: np.random.Generator) -> np.ndarray:
        """What the effect adds to sound sessions."""
        return self.changed[random.integers(len(self.changed), size=n)] - self.sound.mean(axis=0)


class Told(NamedTuple):
    """What is said of a change.

    Attributes:
        after: Sessions since it began, that of the alarm included; infinite if it is not told, or before it.
        is_right: Whether the joint that shows it most has it; None: it is not told.
        trend_holds: Whether the interval of its growth holds the true one; None: there is no trend.
    """

    after: float
    is_right: bool | None = None
    trend_holds: bool | None = None


def resample(path: Path) -> None:
    """Print a machine's figures as a row of Markdown, by family on standard error."""
    with np.load(path) as file:
        statistics, label = file["statistics"], file["label"]
    simulator, _, number = path.stem.rpartition("_")
    joints, names = {of.label: of.joints for of in plan(simulator, int(number))}, machine().joint_names
    config, random = load_section("watch", WatchConfig, PROFILE), np.random.default_rng(0)
    sound = statistics[np.isin(label, (NOMINAL, SOUND, OTHER))]
    pools = {
        kind: Pool(sound, statistics[label == kind], [names.index(joint) for joint in joints[kind]])
        for kind in kinds.SETS_IN
    }
    null = pools[kinds.SETS_IN[0]]
    alarms = sum(
        bool(follow(null.drawn(N_NOMINAL, random), null.drawn(N_SESSION, random), [], config).changes)
        for _ in range(N_MACHINE)
    )
    found: dict[str, list[Told]] = {"step": [], "ramp": []}
    for kind, pool in pools.items():
        for course, of in found.items():
            of += (these := [_told(pool, course, random, config) for _ in range(REPEATS)])
            text = f"told after {_spread(these, ' sessions, 90 % by ')}"
            print(f"{path.stem}, {kind}, {course}: {text}", file=sys.stderr)
    repairs = [_repaired(pool, random, config) for pool in pools.values() for _ in range(REPEATS)]
    cells = [f"{alarms} of {N_MACHINE}", *(_spread(of) for of in found.values())]
    cells += [_share([one.is_right for one in of]) for of in found.values()]
    cells += [_share([one.trend_holds for one in found["ramp"]])]
    cells += [_spread([Told(after) for after in repairs if after is not None])]
    print(f"| {path.stem} | {' | '.join(cells)} |")


def _told(pool: Pool, course: str, random: np.random.Generator, config: WatchConfig) -> Told:
    before = int(random.integers(*BEFORE))
    series = pool.drawn(before + AFTER, random)
    if course == "step":
        series[before:] += pool.stepped(AFTER, random)
    else:
        series[before:] += np.minimum(np.arange(1, AFTER + 1) / RAMP, 1.0)[:, None, None] * pool.shift
    nominal = pool.drawn(N_NOMINAL, random)
    changes = follow(nominal, series, [], config).changes
    since = changes[0].alarm - before + 1 if changes else 0
    if since <= 0:
        return Told(np.inf)
    holds = _trend_holds(pool, series[: before + RAMP], nominal, config) if course == "ramp" else None
    return Told(float(since), changes[-1].leading.joint in pool.joints, holds)


def _trend_holds(pool: Pool, grown: np.ndarray, nominal: np.ndarray, config: WatchConfig) -> bool | None:
    """Of a ramp that has just reached its full size."""
    changes = follow(nominal, grown, [], config).changes
    if not changes or changes[-1].end is not None:
        return None
    joint, statistic, mean, _ = changes[-1].leading
    trend = trend_of(grown[changes[-1].onset.first :, joint, statistic], mean, None)
    if trend is None:
        return None
    low, high = trend.ci95
    return bool(low <= pool.shift[joint, statistic] / RAMP <= high)


def _repaired(pool: Pool, random: np.random.Generator, config: WatchConfig) -> float | None:
    """Sessions since a repair until the machine is told as healthy; None: it was not told as changed."""
    repair = int(random.integers(*BEFORE)) + BROKEN
    series = pool.drawn(repair + AFTER_REPAIR, random)
    series[repair - BROKEN : repair] += pool.stepped(BROKEN, random)
    nominal = pool.drawn(N_NOMINAL, random)
    for since in range(1, AFTER_REPAIR + 1):  # as it is looked at after every session
        changes = follow(nominal, series[: repair + since], [], config).changes
        if not changes or changes[-1].alarm >= repair:
            return None
        end = changes[-1].end
        if end is not None:
            return float(since) if end >= repair else None
    return np.inf


def _share(of: Sequence[bool | None]) -> str:
    known = [one for one in of if one is not None]
    return f"{sum(known)} of {len(known)}"


def _spread(of: Sequence[Told], between: str = " | ") -> str:
    """The median, and what nine of ten do not exceed."""
    after = [one.after for one in of]
    return f"{np.median(after):g}{between}{np.quantile(after, 0.9, method='higher'):g}"
