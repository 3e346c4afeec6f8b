"""Put messages in order of time that stand in the file in another order, which all formats allow.

Log time that steps back has one of two causes. Messages were stored in another order than they were recorded in, by
several threads or from a cache. Or the recorder's clock was set back. Each step of the joint samples is judged, or of
the commands if those ascend:

- At a step of the recorder's clock alone, header stamps do not step back with log time.
- Sorted by time, reordered messages leave no hole. If the time that a step goes back over has one, the clock was set
  back.
- A clock that is set back covers the time that it goes back over twice. The samples in that time are counted. They
  cover it once or twice if their number agrees with one of the two, and not with the other. What is expected comes from
  the rate where no stretches between steps overlap; numbers agree within two standard deviations of independent
  arrivals (√n). Steps that agree with both are judged together.
- Where that does not decide, a log whose stretches cover its time more than twice on average was reordered.

A recorder has one clock: steps of other streams are the clock's where they go back over the same time (intersection
above half of the union). The streams are sorted between the clock's steps, at which the log is split (`ordering`). What
cannot be decided is told, and taken for the clock, so that no command is put where it was not in force.
"""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.logs.conditioning.ordering import split_at_steps_back
from pipeline.logs.conditioning.samples import Samples
from pipeline.logs.conditioning.stray_stamps import drop_stray_stamps
from pipeline.logs.messages.columns import SECTION_ROWS, Column, ColumnStore, sections
from pipeline.logs.messages.message_blocks import MAXIMUM_TIME_NS
from pipeline.logs.messages.raw_log import Note, NoteKind, RawLog

MAXIMUM_STRETCHES = 1 << 16  # some megabytes
MAXIMUM_SORTED_BYTES = 1 << 27  # at once; sorting holds three copies, within the 512 MiB that a log may take
STANDARD_DEVIATIONS = 2


@dataclass(frozen=True)
class Stretches:
    """The stretches of a stream between steps back of its log time; stray times are not counted.

    Attributes:
        first_row: Shape (k,), int64.
        low: Earliest time, shape (k,), int64.
        high: Latest time, shape (k,), int64.
        back: Time after and before each step, shape (k - 1, 2), int64.
        is_apart: At which steps header stamps do not step with log time, shape (k - 1,), bool.
    """

    first_row: np.ndarray
    low: np.ndarray
    high: np.ndarray
    back: np.ndarray
    is_apart: np.ndarray


def in_order_of_time(raw: RawLog, gap_ns: int, store: ColumnStore) -> tuple[RawLog, list[Note]]:
    """Sort the messages of a log by log time if they are reordered.

    Args:
        gap_ns: Shorter steps back are left to `sort_by_time`.
        store: Stores sorted columns.

    Returns:
        The log, and what was done.
    """
    joints = stretches(raw.joint_log_time_ns, raw.joint_stamp_ns, gap_ns)
    commands = stretches(raw.command_log_time_ns, None, gap_ns)
    if not (len(joints.back) or len(commands.back)):
        return raw, []
    leading, times = joints, raw.joint_log_time_ns
    if not len(joints.back):
        leading, times = commands, raw.command_log_time_ns
    is_clock, is_decided = steps_of_clock(times, leading, gap_ns)
    if is_clock is None:
        text = (
            "log time steps back; whether messages are stored out of order or the clock was set back cannot be "
            "decided; taken for the clock"
        )
        return raw, [Note(NoteKind.attention, text)]
    if is_clock.all():
        return raw, []
    at, notes = leading.back[is_clock], []

    def ordered(what: str, own: Stretches, is_own: np.ndarray, columns: dict[str, Column]) -> dict[str, Any]:
        if is_own.all():  # or nothing steps back
            return {}
        bounds = own.first_row[1:][is_own]
        found = _sorted(columns, bounds.tolist(), store, f"{what.replace(' ', '_')}_in_order")
        text = f"{what} are stored out of order of their log time; put in order"
        if found is None:
            text = f"{what} are stored too far out of order of their log time to be sorted"
        kind = NoteKind.attention if found is None else NoteKind.changed
        notes.append(Note(kind, text, len(next(iter(columns.values())))))
        return found or {}

    def go_back_over_these(own: Stretches) -> np.ndarray:
        return np.array([_is_over(step, at).any() for step in own.back], bool)

    def chosen(*names: str) -> dict[str, Column]:
        return {name: getattr(raw, name) for name in names if getattr(raw, name) is not None}

    of_joints = chosen("joint_log_time_ns", "joint_stamp_ns", "q")
    found = ordered("joint samples", joints, go_back_over_these(joints), of_joints)
    if raw.joint_stamp_ns is raw.joint_log_time_ns and found:
        found["joint_stamp_ns"] = found["joint_log_time_ns"]  # a table has one time only
    of_commands = chosen("command_log_time_ns", "command_stamp_ns", "command")
    found |= ordered("commands", commands, go_back_over_these(commands), of_commands)
    channels = dict(raw.channels)
    for name, samples in raw.channels.items():
        own = stretches(samples.time_ns, None, gap_ns)
        values = {"time_ns": samples.time_ns, "value": samples.value}
        values |= ordered(f"samples of channel {name}", own, go_back_over_these(own), values)
        channels[name] = replace(samples, **values)
    if not is_decided:
        text = "messages are out of order throughout; whether the clock was set back too cannot be decided"
        notes.append(Note(NoteKind.attention, text))
    return replace(raw, **found, channels=channels), notes


def stretches(log_time_ns: Column, stamp_ns: Column | None, gap_ns: int) -> Stretches:
    """Return a stream's stretches; `MAXIMUM_STRETCHES` and one if there are more.

    Args:
        log_time_ns: shape (N,), int64.
        stamp_ns: Header stamps, shape (N,), int64; None without.
        gap_ns: Shorter steps back do not count.
    """
    low: list[int] = []
    high: list[int] = []
    rows: list[int] = []
    steps: list[tuple[int, int]] = []
    apart: list[bool] = []
    last = (0, 0)
    if any((np.diff(part) < -gap_ns).any() for part in _with_next(log_time_ns)):
        for piece in _pieces(log_time_ns, log_time_ns if stamp_ns is None else stamp_ns, gap_ns):
            time_ns, (stamps, row) = piece.time_ns, piece.value.T
            if piece.era == len(low):
                if low:
                    steps.append((int(time_ns[0]), last[0]))
                    moved = (stamps[0] - last[1]) - (time_ns[0] - last[0])
                    apart.append(bool(stamps[0] and last[1] and abs(moved) > gap_ns))
                low.append(int(time_ns.min()))
                high.append(int(time_ns.max()))
                rows.append(int(row[0]))
            low[-1], high[-1] = min(low[-1], int(time_ns.min())), max(high[-1], int(time_ns.max()))
            last = int(time_ns[-1]), int(stamps[-1])
            if len(low) > MAXIMUM_STRETCHES:
                break
    first_row, lowest, highest = (np.array(column, np.int64) for column in (rows, low, high))
    back = np.array(steps, np.int64).reshape(-1, 2)
    return Stretches(first_row, lowest, highest, back, np.array(apart, bool))


def steps_of_clock(log_time_ns: Column, own: Stretches, gap_ns: int) -> tuple[np.ndarray | None, bool]:
    """Tell steps of the clock from reordered messages.

    Returns:
        Which steps back are the clock's, shape (k - 1,), bool; None if that cannot be decided. Whether each was decided
        by itself, and not only by the overlap of all.

    Args:
        log_time_ns: Shape (N,), int64.
        own: The stretches of these.
        gap_ns: Longer times without samples are holes.
    """
    if len(own.low) > MAXIMUM_STRETCHES:
        return None, False
    if not len(own.back):
        return own.is_apart, True
    holes = _holes(own, gap_ns)
    hole = np.searchsorted(holes[:, 0], own.back[:, 0])  # the first one behind where the step leads to
    is_clock = own.is_apart | (np.append(holes[:, 1], MAXIMUM_TIME_NS)[hole] <= own.back[:, 1])
    n, per_ns, n_outside = _counts(log_time_ns, own, gap_ns)
    length = np.diff(own.back)[:, 0]
    is_once, is_twice = (_may_be(n, times * per_ns * length, n_outside) for times in (1, 2))
    if (is_open := is_once & is_twice & ~is_clock).any():  # too few samples in each: all together
        total, expected = n[is_open].sum(), per_ns * length[is_open].sum()
        is_once[is_open] = _may_be(total, expected, n_outside)
        is_twice[is_open] = _may_be(total, 2 * expected, n_outside)
    is_double = is_twice & ~is_once
    for step in own.back[is_double]:  # other steps may go back over a part of its time, too
        common = np.minimum(own.back[:, 1], step[1]) - np.maximum(own.back[:, 0], step[0])
        length = length + np.maximum(common, 0)
    is_once |= _may_be(n, per_ns * length, n_outside) & ~is_double
    is_clock |= is_double
    total_ns = (own.high - own.low).sum()
    is_shuffled = total_ns > 2 * (own.high.max() - own.low.min())
    is_decided = not (~is_clock & (is_once == is_twice)).any()
    return (is_clock if is_decided or is_shuffled else None), is_decided


def _may_be(n: np.ndarray, expected: np.ndarray, n_outside: int) -> np.ndarray:
    """Whether numbers of samples agree with expected ones, which are extrapolated from a number outside."""
    deviation = np.sqrt(expected * (1 + expected / max(n_outside, 1)))
    return np.abs(n - expected) <= STANDARD_DEVIATIONS * deviation


def _is_over(back: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Whether steps go back over a time: the intersection is above half of the union; shapes (…, 2)."""
    intersection = np.minimum(back[..., 1], other[..., 1]) - np.maximum(back[..., 0], other[..., 0])
    union = np.maximum(back[..., 1], other[..., 1]) - np.minimum(back[..., 0], other[..., 0])
    return 2 * intersection > union


def _with_next(column: Column) -> Iterator[np.ndarray]:
    """Yield each section of a column with the first row of the next."""
    return (column[row : row + SECTION_ROWS + 1] for row in range(0, len(column), SECTION_ROWS))


def _pieces(log_time_ns: Column, stamp_ns: Column, gap_ns: int) -> Iterator[Samples]:
    """Yield the stretches' samples; their values are header stamp and row."""
    begin = 0

    def samples() -> Iterator[Samples]:
        nonlocal begin
        for time_ns, stamp in sections((log_time_ns, stamp_ns)):
            yield Samples(time_ns, np.stack([stamp, begin + np.arange(len(stamp))], axis=1))
            begin += len(stamp)

    return split_at_steps_back(drop_stray_stamps(samples(), gap_ns, "", "", []), gap_ns)


def _holes(own: Stretches, gap_ns: int) -> np.ndarray:
    """Return the times longer than `gap_ns` that lie within none of the stretches, shape (n, 2)."""
    order = np.argsort(own.low)
    low, high = own.low[order], np.maximum.accumulate(own.high[order])
    is_hole = low[1:] - high[:-1] > gap_ns
    return np.stack([high[:-1][is_hole], low[1:][is_hole]], axis=1)


def _counts(log_time_ns: Column, own: Stretches, gap_ns: int) -> tuple[np.ndarray, float, int]:
    """Return the samples in the time of each step, the samples per ns where no stretches overlap, and their number."""
    bounds = np.unique(np.concatenate([own.low, own.high, own.back.ravel()]))
    after, before = (np.searchsorted(bounds, times) for times in own.back.T)
    n_begun, n_ended = (
        np.bincount(np.searchsorted(bounds, times) + 1, minlength=len(bounds) + 1)
        for times in (own.low, own.high)
    )
    is_within = np.cumsum(n_begun - n_ended) > 1  # of the times up to each bound, from the one before
    n_at, n_outside, total_ns = np.zeros(len(bounds) + 1, np.int64), 0, 0
    for piece in _pieces(log_time_ns, log_time_ns, gap_ns):
        time_ns = np.sort(piece.time_ns)
        place = np.searchsorted(bounds, time_ns)
        np.add.at(n_at, place, 1)
        interval = np.diff(time_ns)
        is_outside = ~is_within[place[1:]] & ~is_within[place[:-1]] & (interval <= gap_ns)
        n_outside += int(is_outside.sum())
        total_ns += int(interval[is_outside].sum())
    n_until = np.cumsum(n_at)
    return n_until[before] - n_until[after], n_outside / max(total_ns, 1), n_outside


def _sorted(
    columns: Mapping[str, Column], bounds: list[int], store: ColumnStore, table: str
) -> dict[str, Column] | None:
    """Sort columns by the first one, stably, between given rows; None if too much would have to be held at once."""
    time_ns = next(iter(columns.values()))
    row_bytes = sum(column[:1].nbytes for column in columns.values()) + np.dtype(np.int64).itemsize
    for first, end in itertools.pairwise([0, *bounds, len(time_ns)]):
        extents = sorted(
            (int(part.min()), int(part.max()), first + number * SECTION_ROWS)
            for number, (part,) in enumerate(sections((time_ns,), first, end))
        )
        open_until: list[int] = []
        for low, high, _ in extents:
            open_until = [*(until for until in open_until if until >= low), high]
            if len(open_until) * SECTION_ROWS * row_bytes > MAXIMUM_SORTED_BYTES:
                return None
        held: list[np.ndarray] = []
        following = [low for low, _, _ in extents[1:]]
        for (_, _, begin), until in itertools.zip_longest(extents, following):
            part = [column[begin : min(begin + SECTION_ROWS, end)] for column in columns.values()]
            part.append(np.arange(begin, begin + len(part[0])))
            held = [np.concatenate(pair) for pair in zip(held, part, strict=True)] if held else part
            order = np.lexsort((held[-1], held[0]))
            held = [rows[order] for rows in held]
            n_settled = len(order) if until is None else int(np.searchsorted(held[0], until))
            store.append(table, {name: rows[:n_settled] for name, rows in zip(columns, held, strict=False)})
            held = [rows[n_settled:] for rows in held]
    return store.columns(table)
