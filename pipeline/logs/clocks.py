"""Which clock a log's joint samples are timed by, and what was measured about its clocks."""

from dataclasses import dataclass

import numpy as np

from pipeline.logs.raw_log import NANOSECONDS, Note, NoteKind, RawLog

HEADER_STAMP, LOG_TIME = "header stamp", "log time"
DRIFT_WINDOWS = 20


@dataclass(frozen=True)
class ClockReport:
    """What was measured about the clocks of one log.

    Attributes:
        used: `header stamp` (sample time) or `log time` (when the recorder got the message). reason: Why log
        time was used, if it was. offset_s: Median of log time − header stamp: transport and the clocks'
        difference. Reported, not removed. offset_p01_s: Its 1st percentile. offset_p99_s: Its 99th
        percentile. drift_ppm: How fast the recorder's clock gains on the header's, in parts per million.
    """

    used: str
    reason: str
    offset_s: float
    offset_p01_s: float
    offset_p99_s: float
    drift_ppm: float


def choose_clock(
    raw: RawLog, maximum_gap_s: float, maximum_clock_offset_s: float
) -> tuple[np.ndarray, ClockReport, list[Note]]:
    """Choose the joint samples' clock and measure the clocks against each other.

    The header stamp is the sample time (contract, section 1). Log time takes its place where stamps cannot:
    they are zero or all alike, they step back while log time does not, or they are so far from log time that
    they are of another clock than the commands, whose time is log time.

    Args:
        raw: The log.
        maximum_gap_s: A step back longer than this is a step of the clock, a shorter one is reordering.
        maximum_clock_offset_s: Median offset beyond which header stamps are of another clock.

    Returns:
        Time of each joint sample, shape (N,), int64; what was measured; and notes.
    """
    stamp, log_time = raw.joint_stamp_ns, raw.joint_log_time_ns
    offset = (log_time - stamp) / NANOSECONDS
    median = float(np.median(offset))
    gap_ns = maximum_gap_s * NANOSECONDS
    reason = ""
    if (stamp == 0).any():
        reason = f"{int((stamp == 0).sum())} header stamps are zero"
    elif len(stamp) > 1 and (stamp == stamp[0]).all():
        reason = "all header stamps are alike"
    elif abs(median) > maximum_clock_offset_s:
        reason = f"header stamps are {median:.3f} s from log time, so of another clock than the commands"
    elif (np.diff(stamp) < -gap_ns).sum() > (np.diff(log_time) < -gap_ns).sum() + _isolated(
        stamp, gap_ns
    ).sum():
        reason = "the header stamps' clock steps back"
    low, high = np.percentile(offset, [1, 99])
    used = LOG_TIME if reason else HEADER_STAMP
    report = ClockReport(used, reason, median, float(low), float(high), drift_ppm(log_time, offset))
    notes = []
    if reason:
        notes.append(Note(NoteKind.changed, f"joint samples are timed by log time: {reason}", len(stamp)))
    return (log_time if reason else stamp), report, notes


def drift_ppm(log_time_ns: np.ndarray, offset_s: np.ndarray) -> float:
    """Return the rate of the offset, in parts per million: a line through the medians of equal stretches."""
    if len(offset_s) < 2 * DRIFT_WINDOWS:
        return 0.0
    time_s = (log_time_ns - log_time_ns[0]) / NANOSECONDS
    at = [np.median(part) for part in np.array_split(time_s, DRIFT_WINDOWS)]
    medians = [np.median(part) for part in np.array_split(offset_s, DRIFT_WINDOWS)]
    if np.ptp(at) == 0:
        return 0.0
    return float(np.polyfit(np.asarray(at) - at[0], np.asarray(medians) - medians[0], 1)[0] * 1e6)


def split_at_steps_back(time_ns: np.ndarray, gap_ns: float) -> list[np.ndarray]:
    """Return the indices of the stretches between steps of the clock back by more than `gap_ns`."""
    steps = np.flatnonzero(np.diff(time_ns) < -gap_ns) + 1
    return np.split(np.arange(len(time_ns)), steps)


def isolated_stamps(time_ns: np.ndarray, gap_ns: float) -> np.ndarray:
    """Return which samples' stamps lie far from both neighbours' while those agree, shape (N,), bool."""
    return _isolated(time_ns, gap_ns)


def _isolated(time_ns: np.ndarray, gap_ns: float) -> np.ndarray:
    isolated = np.zeros(len(time_ns), dtype=bool)
    if len(time_ns) >= 3:
        time = time_ns.astype(np.float64)  # differences of damaged stamps may pass what int64 holds
        far = np.abs(np.diff(time)) > gap_ns
        agree = np.abs(time[2:] - time[:-2]) <= gap_ns
        isolated[1:-1] = far[:-1] & far[1:] & agree
    return isolated
