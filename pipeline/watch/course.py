"""The course of a machine from session to session: healthy, changed, healthy again after a repair.

It follows from the statistics and their order alone; nothing is carried from one look to the next. So a session that
arrives late stands where it was recorded, and none counts twice.

The probability of a false alarm is that until the first change. After each repair or maintenance the evidence begins
anew, and so does this probability.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy.stats import t as students_t

from pipeline.watch.change import Onset, onset_of
from pipeline.watch.evidence import evidence
from pipeline.watch.settings import WatchConfig
from pipeline.watch.statistics import STATISTICS

LEAST = np.array([statistic.least for statistic in STATISTICS])
SURE_OF_REPAIR = 20.0  # times as probable without the change, in two sessions in a row
LATEST = 3  # sessions that say what the change is like now
TIGHTEST = 1.0 / 3.0  # of the smallest change worth telling: no standard deviation is taken as smaller


class State(StrEnum):
    """What is known of a machine, or of a joint."""

    healthy = "healthy"
    changed = "changed"
    not_enough = "not_enough"


class Leading(NamedTuple):
    """Which statistic of which joint shows a change most, and its mean and standard deviation before."""

    joint: int
    statistic: int
    mean: float
    deviation: float


@dataclass(frozen=True)
class Change:
    """One change.

    Attributes:
        alarm: Index of the session after which it was told.
        onset: When it began.
        leading: Where it shows most.
        end: Index of the first session without it; None: it is still there.
    """

    alarm: int
    onset: Onset
    leading: Leading
    end: int | None


@dataclass
class Course:
    """Of t sessions.

    Attributes:
        e_value: (t, n_joint) since the last repair or maintenance; 1 where nothing is known.
        state: (t, n_joint) of `State`.
        machine_e_value: (t,) mean over the joints that can be judged.
        changes: In order.
        is_baseline: (t,) whether the session is one that the null is learned from.
    """

    e_value: np.ndarray
    state: np.ndarray
    machine_e_value: np.ndarray
    changes: list[Change] = field(default_factory=list)
    is_baseline: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))


def follow(
    nominal: np.ndarray, sessions: np.ndarray, baselines: Sequence[int], config: WatchConfig
) -> Course:
    """Judge every session in the light of those before it.

    Args:
        nominal: (n, n_joint, n_statistic) of the nominal sessions.
        sessions: (t, n_joint, n_statistic) in the order of recording.
        baselines: Indices of sessions with which a new baseline begins, after maintenance.
        config: Section `watch`.
    """
    n_session, n_joint, _ = sessions.shape
    course = Course(
        np.ones((n_session, n_joint)),
        np.full((n_session, n_joint), State.not_enough, object),
        np.ones(n_session),
        is_baseline=np.zeros(n_session, bool),
    )
    begins = sorted({index for index in baselines if index < n_session})
    known, begin = nominal, 0
    for end in [*begins, n_session]:
        _follow_stretch(course, known, sessions, begin, end, config)
        known = sessions[end : end + config.least_nominal]
        begin = end + len(known)
        course.is_baseline[end:begin] = True
    return course


def _follow_stretch(
    course: Course, known: np.ndarray, sessions: np.ndarray, begin: int, end: int, config: WatchConfig
) -> None:
    """Sessions between two acts of maintenance; `known` are those that the null is learned from."""
    while begin < end:
        judged = np.flatnonzero(np.isfinite(known).all(axis=2).sum(axis=0) >= config.least_nominal)
        if not len(judged):
            return
        stretch = sessions[begin:end][:, judged]
        found = _evidence(known[:, judged], stretch)
        values = found.mean(axis=2)
        whole = values.mean(axis=1)
        course.e_value[begin:end, judged] = values
        course.machine_e_value[begin:end] = whole
        told = np.isfinite(stretch).any(axis=2)
        course.state[begin:end, judged] = np.where(told, State.healthy, State.not_enough)
        over = np.flatnonzero(whole >= 1.0 / config.false_alarms)
        if not len(over):
            return
        alarm = int(over[0])
        leading = _leading(known, found[alarm], judged)
        series = sessions[begin:end, leading.joint, leading.statistic]
        onset = onset_of(series[: alarm + 1], leading.mean, leading.deviation)
        repaired = _repaired(series, onset.first, alarm, leading, len(known))
        last = len(series) if repaired is None else repaired
        onset = onset_of(series[:last], leading.mean, leading.deviation)
        for index in range(alarm, last):
            changed = judged[_changed_joints(values[index], config.false_alarms)]
            course.state[begin + index, changed] = State.changed
        shifted = Onset(
            begin + onset.first, (begin + onset.interval[0], begin + onset.interval[1]), onset.is_ramp
        )
        final = None if repaired is None else begin + repaired
        course.changes.append(Change(begin + alarm, shifted, leading, final))
        if repaired is None:
            return
        known = np.concatenate([known, sessions[begin : begin + onset.interval[0]]])
        begin += repaired


def _evidence(known: np.ndarray, stretch: np.ndarray) -> np.ndarray:
    """(t, n_joint, n_statistic) e-values."""
    n_session, n_joint, n_statistic = stretch.shape
    flat = evidence(known.reshape(len(known), -1), stretch.reshape(n_session, -1), np.tile(LEAST, n_joint))
    return flat.reshape(n_session, n_joint, n_statistic)


def _changed_joints(values: np.ndarray, false_alarms: float) -> np.ndarray:
    """Joints that e-BH rejects (Wang and Ramdas, 2022), or the foremost where only all together are evidence."""
    order = np.argsort(-values)
    enough = values[order] * np.arange(1, len(values) + 1) >= len(values) / false_alarms
    n_changed = int(np.flatnonzero(enough)[-1]) + 1 if enough.any() else 1
    return order[:n_changed]


def _leading(known: np.ndarray, found: np.ndarray, judged: np.ndarray) -> Leading:
    """Of e-values (n_judged, n_statistic) at the alarm."""
    joint, statistic = np.unravel_index(int(np.argmax(found)), found.shape)
    before = known[:, judged[joint], statistic]
    deviation = max(float(np.nanstd(before, ddof=1)), TIGHTEST * LEAST[statistic])
    return Leading(int(judged[joint]), int(statistic), float(np.nanmean(before)), deviation)


def _repaired(series: np.ndarray, onset: int, alarm: int, leading: Leading, n_known: int) -> int | None:
    """Index of the first of two sessions in a row that are as before the change; None: there are none."""
    during = [value for value in series[onset : alarm + 1] if np.isfinite(value)]
    run: list[tuple[int, float, float]] = []  # sessions rather as before: index, value, log ratio
    for index in range(alarm + 1, len(series)):
        value = float(series[index])
        if not np.isfinite(value):
            continue
        ratio = _log_ratio(value, during[-LATEST:], leading, n_known)
        if ratio <= 0.0:
            during += [*(of for _, of, _ in run), value]
            run = []
            continue
        run.append((index, value, ratio))
        if len(run) >= 2 and sum(of for *_, of in run) >= np.log(SURE_OF_REPAIR):
            return run[0][0]
    return None


def _log_ratio(value: float, latest: list[float], leading: Leading, n_known: int) -> float:
    """How much more probable a value is without the change."""
    spread = leading.deviation * np.sqrt(1.0 + 1.0 / n_known)
    wide = max(spread, float(np.std(latest)))
    without = students_t.logpdf(value, n_known - 1, leading.mean, spread)
    return float(without - students_t.logpdf(value, n_known - 1, float(np.mean(latest)), wide))
