"""Choice of the clock for a log's joint samples, and measurements of its clocks."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from pipeline.logs.conditioning.order_statistics import quantiles
from pipeline.logs.messages.columns import SECTION_ROWS, Column, sections
from pipeline.logs.messages.raw_log import NANOSECONDS, Note, NoteKind, RawLog

HEADER_STAMP, LOG_TIME = "header stamp", "log time"
DRIFT_WINDOWS = 20


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
    raw: RawLog, maximum_gap_s: float, maximum_clock_offset_s: float
) -> tuple[Column, ClockReport, list[Note]]:
    """Choose the joint samples' clock and measure the clocks against each other.

    The header stamp is the sample time (contract, section 1). Log time replaces it if stamps
    are zero or all equal, if they step back while log time does not, or if they are so far from log time that they come
    from another clock. Commands always have log time.

    Args:
        raw: The log.
        maximum_gap_s: Longer steps back are steps of the clock; shorter ones are reordered messages.
        maximum_clock_offset_s: Median offset beyond which header stamps come from another clock.

    Returns:
        Time of each joint sample, a column of shape (N,), int64; the measurements; and notes.
    """
    stamp, log_time = raw.joint_stamp_ns, raw.joint_log_time_ns
    low, median, high = quantiles(lambda: _offsets_s(stamp, log_time), [0.01, 0.5, 0.99])
    reason = _why_not_stamps(
        stamp, log_time, median, round(maximum_gap_s * NANOSECONDS), maximum_clock_offset_s
    )
    used = LOG_TIME if reason else HEADER_STAMP
    report = ClockReport(used, reason, median, low, high, drift_ppm(stamp, log_time))
    notes = []
    if reason:
        notes.append(Note(NoteKind.changed, f"joint samples are timed by log time: {reason}", len(stamp)))
    return (log_time if reason else stamp), report, notes


def _why_not_stamps(
    stamp: Column, log_time: Column, median_offset_s: float, gap_ns: int, maximum_clock_offset_s: float
) -> str:
    """Return why header stamps cannot be used; empty if they can."""
    first = int(stamp[0:1][0])
    n_zero = n_alike = 0
    for (part,) in sections((stamp,)):
        n_zero += int((part == 0).sum())
        n_alike += int((part == first).sum())
    if n_zero:
        return f"{n_zero} header stamps are zero"
    if n_alike == len(stamp) > 1:
        return "all header stamps are alike"
    if abs(median_offset_s) > maximum_clock_offset_s:
        return (
            f"header stamps are {median_offset_s:.3f} s from log time, so of another clock than the commands"
        )
    n_back, n_isolated = _steps_back(stamp, gap_ns)
    if n_back > _steps_back(log_time, gap_ns)[0] + n_isolated:
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


def extent_without_outliers(time_ns: Column, gap_ns: int) -> tuple[int, int]:
    """Return the first and the last time of a column of shape (N,), isolated stamps excluded."""
    low, high = [], []
    for part, begin, end in _with_neighbours(time_ns):
        steady = part[begin:end][~isolated_stamps(part, gap_ns)[begin:end]]
        if len(steady):
            low.append(int(steady.min()))
            high.append(int(steady.max()))
    return min(low), max(high)


def isolated_stamps(time_ns: np.ndarray, gap_ns: int) -> np.ndarray:
    """Return which stamps lie far from both neighbours while these agree, shape (N,), bool."""
    isolated = np.zeros(len(time_ns), dtype=bool)
    if len(time_ns) >= 3:
        time = time_ns.astype(np.float64)  # differences of damaged stamps may overflow int64
        far = np.abs(np.diff(time)) > gap_ns
        agree = np.abs(time[2:] - time[:-2]) <= gap_ns
        isolated[1:-1] = far[:-1] & far[1:] & agree
    return isolated


def _offsets_s(
    stamp: Column, log_time: Column, begin: int = 0, end: int | None = None
) -> Iterator[np.ndarray]:
    return ((late - early) / NANOSECONDS for early, late in sections((stamp, log_time), begin, end))


def _elapsed_s(time_ns: Column, start_ns: int, begin: int, end: int) -> Iterator[np.ndarray]:
    return ((part - start_ns) / NANOSECONDS for (part,) in sections((time_ns,), begin, end))


def _steps_back(time_ns: Column, gap_ns: int) -> tuple[int, int]:
    """Count steps back of more than `gap_ns`, and isolated stamps."""
    n_back = n_isolated = 0
    for part, begin, end in _with_neighbours(time_ns):
        n_back += int((np.diff(part[:end]) < -gap_ns).sum())
        n_isolated += int(isolated_stamps(part, gap_ns)[begin:end].sum())
    return n_back, n_isolated


def _with_neighbours(time_ns: Column) -> Iterator[tuple[np.ndarray, int, int]]:
    """Yield each section extended by one time on either side, and the section's bounds within it."""
    for row in range(0, len(time_ns), SECTION_ROWS):
        first = max(row - 1, 0)
        yield time_ns[first : row + SECTION_ROWS + 1], row - first, row - first + SECTION_ROWS
