"""Choice of the clock for a log's joint samples, and measurements of its clocks."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from pipeline.logs.conditioning.clock_steps import step_apart_ns
from pipeline.logs.conditioning.order_statistics import quantiles
from pipeline.logs.conditioning.ordering import split_at_steps_back
from pipeline.logs.conditioning.samples import Samples
from pipeline.logs.conditioning.stray_stamps import steady_stamps
from pipeline.logs.messages.columns import Column, sections
from pipeline.logs.messages.raw_log import NANOSECONDS, Note, NoteKind, RawLog
from pipeline.machine.log_sources import ClockChoice, CommandSource, JointStateSource
from pipeline.machine.specification import MachineSpecification

HEADER_STAMP, LOG_TIME = "header stamp", "log time"
AS_RECORDED = JointStateSource()
DRIFT_WINDOWS = 20
MAXIMUM_UNSET = 0.01  # share of header stamps without time (zero) up to which the others are used


@dataclass(frozen=True)
class ClockReport:
    """Measurements of one log's clocks.

    Attributes:
        used: `header stamp` (sample time) or `log time` (when the recorder got the message).
        reason: Why log time was used; empty for header stamps.
        offset_s: Median of log time − header stamp: transport delay plus clock difference. It is reported, not removed.
        offset_p01_s: Its 1st percentile.
        offset_p99_s: Its 99th percentile.
        drift_ppm: How fast the recorder's clock gains on the header's, in parts per million.
    """

    used: str
    reason: str
    offset_s: float
    offset_p01_s: float
    offset_p99_s: float
    drift_ppm: float


def choose_clock(
    raw: RawLog,
    maximum_gap_s: float,
    maximum_clock_offset_s: float,
    source: JointStateSource = AS_RECORDED,
    commands_offset_s: float = 0.0,
) -> tuple[Column, ClockReport, list[Note]]:
    """Choose the joint samples' clock and measure the clocks against each other.

    The header stamp is the sample time (contract, section 1). Unless the machine's configuration names the clock, log
    time replaces it if more than a few stamps are zero, if all are equal, if one of the two clocks steps and the other
    does not, or if they are so far from the commands' times that they come from another clock.

    Args:
        maximum_gap_s: Longer steps back are steps of the clock; shorter ones are reordered messages.
        maximum_clock_offset_s: Median offset beyond which header stamps come from another clock.
        source: The machine's configuration of the topic: its clock, and the offset that is added to its times.
        commands_offset_s: How far log time is after the commands' times.

    Returns:
        Time of each joint sample, a column of shape (N,), int64; the measurements; and notes.
    """
    gap_ns, choice = round(maximum_gap_s * NANOSECONDS), ClockChoice(source.clock)
    stamp, log_time = raw.joint_stamp_ns, raw.joint_log_time_ns
    has_stamps = stamp is not log_time  # tables have one time only
    stamp = shifted(stamp, source.clock_offset_s, gap_ns)
    low, median, high = quantiles(lambda: _offsets_s(stamp, log_time), [0.01, 0.5, 0.99])
    reason = ""
    if choice is ClockChoice.log_time:
        reason = "the machine's configuration says so"
        log_time = shifted(log_time, source.clock_offset_s, gap_ns)
    elif choice is ClockChoice.automatic and has_stamps:
        apart_s = median - commands_offset_s
        reason = _why_not_stamps(stamp, log_time, apart_s, gap_ns, maximum_clock_offset_s)
        if not reason and raw.command_stamp_ns is None and (by_ns := step_apart_ns(stamp, log_time, gap_ns)):
            way = "forward" if by_ns > 0 else "back"
            reason = f"log time steps {way} by {abs(by_ns) / NANOSECONDS:.1f} s against header stamps"
    used = LOG_TIME if reason else HEADER_STAMP
    report = ClockReport(used, reason, median, low, high, drift_ppm(stamp, log_time))
    notes = []
    if reason and choice is ClockChoice.automatic:
        text = f"joint samples are timed by log time: {reason}"
        if source.clock_offset_s:
            text += f"; the stated clock_offset_s of {source.clock_offset_s:g} s is not used"
        notes.append(Note(NoteKind.changed, text, len(stamp)))
    return (log_time if reason else stamp), report, notes


def command_times(raw: RawLog, source: CommandSource, gap_ns: int) -> tuple[Column, float]:
    """Return the commands' times, a column of shape (M,), int64, and the median by which log time is after them, s.

    The latter is zero where log time times the commands: what is added to it then is not a difference of clocks.
    """
    stamp, log_time = raw.command_stamp_ns, raw.command_log_time_ns
    if stamp is None:
        return shifted(log_time, source.clock_offset_s, gap_ns), 0.0
    stamp = shifted(stamp, source.clock_offset_s, gap_ns)
    return stamp, quantiles(lambda: _offsets_s(stamp, log_time), [0.5])[0]


def offset_warnings(
    raw: RawLog, clock: ClockReport, commands_offset_s: float, machine: MachineSpecification
) -> list[Note]:
    """Warn of clocks of joint states and commands that differ by more than a control period.

    Log time is what both can be compared with. If the configuration names header stamps for both, they are trusted.
    An offset stated for commands on log time may mend their clock or their delay; either reading may be right.
    """
    unstated_s = (clock.offset_s if clock.used == HEADER_STAMP else 0.0) - commands_offset_s
    apart_s = unstated_s + (machine.commands.clock_offset_s if raw.command_stamp_ns is None else 0.0)
    has_chosen = raw.command_stamp_ns is not None and machine.joint_states.clock == ClockChoice.header_stamp
    if raw.joint_stamp_ns is raw.joint_log_time_ns:  # one time for all: nothing to compare
        return []
    if min(abs(apart_s), abs(unstated_s)) <= machine.dt_s or has_chosen:
        return []
    text = (
        f"the times of {machine.joint_states.topic} are {abs(apart_s):.3f} s "
        f"{'before' if apart_s > 0 else 'after'} those of {machine.commands.topic}, measured against log time, so rows "
        f"may hold commands that were not in force; choose joint_states.clock or commands.clock, or state the "
        f"clock_offset_s of either, in conf/machine/{machine.name}.yaml"
    )
    return [Note(NoteKind.warning, text, len(raw.q))]


def shifted(time_ns: Column, offset_s: float, gap_ns: int) -> Column:
    """Return a column of times with an offset added to each but those that are unset."""
    if offset_s == 0.0:
        return time_ns
    return _Shifted(time_ns, round(offset_s * NANOSECONDS), count_unset(time_ns, gap_ns) > 0)


@dataclass(frozen=True)
class _Shifted:
    time_ns: Column
    offset_ns: int
    keeps_zero: bool

    def __len__(self) -> int:
        return len(self.time_ns)

    def __getitem__(self, rows: slice) -> np.ndarray:
        part = self.time_ns[rows]
        return np.where(part == 0, 0, part + self.offset_ns) if self.keeps_zero else part + self.offset_ns


def count_unset(time_ns: Column, gap_ns: int) -> int:
    """Count the times that are zero because a clock had not started: all others lie further from zero than a gap."""
    n_zero, nearest = 0, math.inf
    for (part,) in sections((time_ns,)):
        is_zero = part == 0
        n_zero += int(is_zero.sum())
        if not is_zero.all():
            nearest = min(nearest, int(np.abs(part[~is_zero]).min()))
    return n_zero if nearest > gap_ns else 0


def _why_not_stamps(
    stamp: Column, log_time: Column, apart_s: float, gap_ns: int, maximum_clock_offset_s: float
) -> str:
    """Return why header stamps cannot be used; empty if they can."""
    n_unset = count_unset(stamp, gap_ns)
    if n_unset > MAXIMUM_UNSET * len(stamp):
        return f"{n_unset} header stamps are zero or missing"
    first = int(stamp[0:1][0])
    n_alike = sum(int((part == first).sum()) for (part,) in sections((stamp,)))
    if n_alike == len(stamp) > 1:
        return "all header stamps are alike"
    if abs(apart_s) > maximum_clock_offset_s:
        return f"header stamps are {apart_s:.3f} s from log time, so of another clock than the commands"
    if _steps_back(stamp, gap_ns) > _steps_back(log_time, gap_ns):
        return "the header stamps' clock steps back"
    return ""


def drift_ppm(stamp: Column, log_time: Column) -> float:
    """Return the offset's rate in parts per million: the slope of a line through the medians of equal windows."""
    if len(stamp) < 2 * DRIFT_WINDOWS:
        return 0.0
    start = int(log_time[0:1][0])
    bounds = np.linspace(0, len(stamp), DRIFT_WINDOWS + 1).astype(int).tolist()
    at, offset = [], []
    for begin, end in itertools.pairwise(bounds):
        at += quantiles(partial(_elapsed_s, log_time, start, begin, end), [0.5])
        offset += quantiles(partial(_offsets_s, stamp, log_time, begin, end), [0.5])
    if np.ptp(at) == 0:
        return 0.0
    return float(np.polyfit(np.asarray(at) - at[0], np.asarray(offset) - offset[0], 1)[0] * 1e6)


def extremes_without_outliers(time_ns: Column, gap_ns: int) -> list[int]:
    """Return the first and the last times of a column's sections, unset and stray stamps excluded."""
    has_unset = count_unset(time_ns, gap_ns) > 0
    steady = (part[part != 0] if has_unset else part for part in steady_stamps(time_ns, gap_ns))
    return [int(extreme) for part in steady if len(part) for extreme in (part.min(), part.max())]


def _offsets_s(
    stamp: Column, log_time: Column, begin: int = 0, end: int | None = None
) -> Iterator[np.ndarray]:
    """Yield log time − header stamp, s, of samples that have both (or of all, where none has)."""
    for early, late in sections((stamp, log_time), begin, end):
        offset, is_set = (late - early) / NANOSECONDS, (early != 0) & (late != 0)
        yield offset[is_set] if is_set.any() else offset


def _elapsed_s(time_ns: Column, start_ns: int, begin: int, end: int) -> Iterator[np.ndarray]:
    return ((part - start_ns) / NANOSECONDS for (part,) in sections((time_ns,), begin, end))


def _steps_back(time_ns: Column, gap_ns: int) -> int:
    """Count steps back of more than `gap_ns` between the stamps that are not stray."""
    steps = split_at_steps_back((Samples(part, part) for part in steady_stamps(time_ns, gap_ns)), gap_ns)
    return max((section.era for section in steps), default=0)
