"""Put messages in order of time that stand in the file in another order, which all formats allow.

Log time that steps back has one of two causes. Messages were stored in another order than they were recorded in, by
several threads or from a cache. Or the recorder's clock was set back. The rule that tells them apart:

- Sorted by time, reordered messages make one recording: every time is covered once, and no hole is left.
- A clock that is set back covers a time twice. Where the stretches before and after its steps overlap, samples are
  twice as dense as elsewhere.
- Header stamps step back with the log times of reordered messages, but not with the recorder's clock alone.
- No clock is set back every few samples.
- A recorder has one clock. If the joint samples are reordered, the commands are, too.

Reordered messages are sorted; a clock that was set back splits the log (`ordering`). What lies between is told, and
taken for the clock, so that no command is put where it was not in force.
"""

import enum
import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.logs.conditioning.encoder_rules import drop_isolated_stamps
from pipeline.logs.conditioning.ordering import split_at_steps_back
from pipeline.logs.conditioning.samples import Samples
from pipeline.logs.messages.columns import SECTION_ROWS, Column, ColumnStore, sections
from pipeline.logs.messages.raw_log import Note, NoteKind, RawLog

COVERED_ONCE, COVERED_TWICE = 1.25, 1.6  # density of samples where stretches overlap, relative to elsewhere
HOLE = 8  # times the mean interval; longer ones are holes
SHORTEST = 2.0 ** np.arange(-1, 63)  # the shortest interval of each power of two
FEW_INTERVALS = 10
FEW_SAMPLES = 20  # between steps, on average; no clock is set back so often
MAXIMUM_STRETCHES = 1 << 16
MAXIMUM_OVERLAPPING_SECTIONS = 64  # of the file's order, which are sorted at once


class Order(enum.Enum):
    """How a stream's log times stand in the file."""

    ascending = "ascending"
    reordered = "reordered"
    clock_set_back = "clock set back"
    unknown = "unknown"


def in_order_of_time(raw: RawLog, gap_ns: int, store: ColumnStore) -> tuple[RawLog, list[Note]]:
    """Sort the messages of a log by log time if they are reordered.

    Args:
        raw: The log.
        gap_ns: Shorter steps back are left to `sort_by_time`.
        store: Stores sorted columns.

    Returns:
        The log, and what was done.
    """
    joints = order_of(raw.joint_log_time_ns, raw.joint_stamp_ns, gap_ns)
    commands = order_of(raw.command_log_time_ns, raw.command_stamp_ns, gap_ns)
    if joints is Order.reordered and commands is not Order.ascending:
        commands = Order.reordered
    notes = []
    if Order.unknown in (joints, commands) and joints is not Order.reordered:
        text = (
            "log time steps back; whether messages are stored out of order or the clock was set back cannot be "
            "decided; taken for the clock"
        )
        notes.append(Note(NoteKind.attention, text))
    if joints in (Order.clock_set_back, Order.unknown):
        commands = Order.ascending  # or rather of the same clock, at whose steps the log is split
    for order, what, fields in (
        (joints, "joint samples", ("joint_log_time_ns", "joint_stamp_ns", "q")),
        (commands, "commands", ("command_log_time_ns", "command_stamp_ns", "command")),
    ):
        if order is not Order.reordered:
            continue
        columns = {name: getattr(raw, name) for name in fields if getattr(raw, name) is not None}
        ordered: dict[str, Any] | None = _sorted(columns, store, f"{what.replace(' ', '_')}_in_order")
        if ordered is None:
            text = f"{what} are stored too far out of order of their log time to be sorted"
            notes.append(Note(NoteKind.attention, text))
            continue
        if raw.joint_stamp_ns is raw.joint_log_time_ns and "q" in ordered:
            ordered["joint_stamp_ns"] = ordered["joint_log_time_ns"]  # a table has one time only
        raw = replace(raw, **ordered)
        text = f"{what} are stored out of order of their log time; put in order"
        notes.append(Note(NoteKind.changed, text, len(ordered[fields[0]])))
    return raw, notes


def order_of(log_time_ns: Column, stamp_ns: Column | None, gap_ns: int) -> Order:
    """Decide how a stream's messages stand in the file, by the rule of this module.

    Args:
        log_time_ns: shape (N,), int64.
        stamp_ns: Header stamps, shape (N,), int64; None without.
        gap_ns: Shorter steps back do not count.
    """
    if not any((np.diff(part) < -gap_ns).any() for part in _with_next(log_time_ns)):
        return Order.ascending
    columns = (log_time_ns, log_time_ns if stamp_ns is None else stamp_ns)

    def stretches() -> Iterable[Samples]:
        samples = (Samples(time_ns, stamp[:, None]) for time_ns, stamp in sections(columns))
        return split_at_steps_back(drop_isolated_stamps(samples, gap_ns, "", "", []), gap_ns)

    low: list[int] = []
    high: list[int] = []
    last: tuple[int, int] | None = None
    for piece in stretches():
        time_ns, stamps = piece.time_ns, piece.value[:, 0]
        if piece.era == len(low):
            if (
                last
                and stamps[0]
                and last[1]
                and abs((stamps[0] - last[1]) - (time_ns[0] - last[0])) > gap_ns
            ):
                return Order.clock_set_back
            low.append(int(time_ns.min()))
            high.append(int(time_ns.max()))
        low[-1], high[-1] = min(low[-1], int(time_ns.min())), max(high[-1], int(time_ns.max()))
        last = int(time_ns[-1]), int(stamps[-1])
        if len(low) > MAXIMUM_STRETCHES:
            return Order.unknown
    if len(low) == 1:
        return Order.ascending  # but for isolated times
    overlaps, has_hole = _overlaps(low, high, gap_ns)
    if has_hole:
        return Order.clock_set_back
    if not len(overlaps) or len(log_time_ns) < FEW_SAMPLES * len(low):
        return Order.reordered
    density = _density(stretches, overlaps)
    if density >= COVERED_TWICE:
        return Order.clock_set_back
    return Order.reordered if density <= COVERED_ONCE else Order.unknown


def _with_next(column: Column) -> Iterable[np.ndarray]:
    """Yield each section of a column with the first row of the next."""
    return (column[row : row + SECTION_ROWS + 1] for row in range(0, len(column), SECTION_ROWS))


def _overlaps(low: Sequence[int], high: Sequence[int], gap_ns: int) -> tuple[np.ndarray, bool]:
    """Return the times within two stretches or more, shape (n, 2), and whether a longer time is within none."""
    ends = sorted([*((time, 0, 1) for time in low), *((time, 1, -1) for time in high)])
    overlaps, has_hole, depth, since, until = [], False, 0, 0, ends[0][0]
    for time, _, change in ends:
        if depth == 0:
            has_hole |= time - until > gap_ns
        elif depth == 1 and change > 0:
            since = time
        elif depth == 2 and change < 0 and time > since:
            overlaps.append((since, time))
        depth += change
        until = time
    return np.array(overlaps, np.int64).reshape(-1, 2), has_hole


def _density(stretches: Callable[[], Iterable[Samples]], overlaps: np.ndarray) -> float:
    """Return the density of samples in the overlaps, relative to that of single stretches."""
    n_inside = 0
    counts, totals = np.zeros(
        (2, 2, 64)
    )  # intervals outside of overlaps and all, by their power of two; their sums
    for piece in stretches():
        time_ns = np.sort(piece.time_ns)
        overlap = np.searchsorted(overlaps[:, 0], time_ns, side="right") - 1
        is_inside = (overlap >= 0) & (time_ns <= overlaps[overlap, 1])
        n_inside += int(is_inside.sum())
        interval = np.diff(time_ns)
        power = np.frexp(interval.astype(np.float64))[1]
        for row, true in enumerate((~is_inside[1:] & ~is_inside[:-1], np.ones(len(interval), bool))):
            counts[row] += np.bincount(power[true], minlength=64)
            totals[row] += np.bincount(power[true], interval[true], minlength=64)
    row = 0 if counts[0].sum() >= FEW_INTERVALS else 1
    interval_ns = _mean_interval(counts[row], totals[row])
    return (n_inside - len(overlaps)) * interval_ns / float(np.diff(overlaps).sum())


def _mean_interval(count: np.ndarray, total: np.ndarray) -> float:
    """Return the mean interval without holes, from counts and sums by power of two, each of shape (64,)."""
    is_short = count > 0
    while is_short.any():
        mean = float(total[is_short].sum() / count[is_short].sum())
        is_hole = is_short & (HOLE * mean < SHORTEST)
        if not is_hole.any():
            return mean
        is_short &= ~is_hole
    return np.inf


def _sorted(columns: dict[str, Column], store: ColumnStore, table: str) -> dict[str, Column] | None:
    """Sort columns by the first one, stably; None if too many sections would have to be held at once."""
    time_ns = next(iter(columns.values()))
    extents = sorted(
        (int(part.min()), int(part.max()), number) for number, (part,) in enumerate(sections((time_ns,)))
    )
    open_until: list[int] = []
    for low, high, _ in extents:
        open_until = [*(end for end in open_until if end >= low), high]
        if len(open_until) > MAXIMUM_OVERLAPPING_SECTIONS:
            return None
    held: list[np.ndarray] = []
    following = [low for low, _, _ in extents[1:]]
    for (_, _, number), until in itertools.zip_longest(extents, following):
        begin = number * SECTION_ROWS
        part = [column[begin : begin + SECTION_ROWS] for column in columns.values()]
        part.append(np.arange(begin, begin + len(part[0])))
        held = [np.concatenate(pair) for pair in zip(held, part, strict=True)] if held else part
        order = np.lexsort((held[-1], held[0]))
        held = [rows[order] for rows in held]
        n_settled = len(order) if until is None else int(np.searchsorted(held[0], until))
        store.append(table, {name: rows[:n_settled] for name, rows in zip(columns, held, strict=False)})
        held = [rows[n_settled:] for rows in held]
    return store.columns(table)
