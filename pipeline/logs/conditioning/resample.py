"""The machine's time grid: positions by linear interpolation, commands by causal zero-order hold."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.logs.conditioning.channels import HeldChannel
from pipeline.logs.conditioning.command_rules import HeldCommands
from pipeline.logs.conditioning.samples import Samples
from pipeline.logs.messages.raw_log import NANOSECONDS, Note, NoteKind


@dataclass(frozen=True)
class GridRows:
    """Rows of a gap-free stretch of a log, on the machine's grid.

    Attributes:
        segment: Number of the stretch; rows of one stretch may come in several sections.
        stamp_ns: Time of each row, shape (T,), int64.
        q: Positions, shape (T, n_joint), float64, rad or m.
        a: Command in force at each row, shape (T, n_joint), float64; NaN where it is unknown.
        x: Channels, shape (T, n_channel), float64, each in its own unit; NaN where none holds. None without channels.
    """

    segment: int
    stamp_ns: np.ndarray
    q: np.ndarray
    a: np.ndarray
    x: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.stamp_ns)


def resample(
    joints: Iterable[Samples],
    commands: HeldCommands,
    dt_s: float,
    maximum_gap_s: float,
    notes: list[Note],
    channels: Sequence[HeldChannel] = (),
) -> Iterator[GridRows]:
    """Put a log on the grid (contract, section 2).

    Rows start at the first joint sample at or after the first command and follow every `dt_s` until the last joint
    sample. Gaps longer than `maximum_gap_s` are not interpolated: a new segment with its own grid starts at the
    sample after the gap.

    Args:
        joints: Joint samples; times strictly ascending within a stretch.
        commands: Commands of the same eras.
        dt_s: Time step of the grid.
        maximum_gap_s: Longest gap that is interpolated.
        notes: The count of joint samples before the first command is appended here.
        channels: The machine's channels.
    """
    gap_ns, step_ns = round(maximum_gap_s * NANOSECONDS), round(dt_s * NANOSECONDS)
    n_early, stretch = 0, -1
    segment: _Segment | None = None
    number = -1
    for section in joints:
        if not len(section):
            continue
        if section.stretch != stretch:
            stretch, segment = section.stretch, None
        if segment is None:
            first_ns = commands.begin(section.era)
            early = len(section) if first_ns is None else int(np.searchsorted(section.time_ns, first_ns))
            n_early, section = n_early + early, section[early:]
            if not len(section):
                continue
        joined = section.time_ns if segment is None else np.concatenate([[segment.last_ns], section.time_ns])
        starts = np.flatnonzero(np.diff(joined) > gap_ns) + 1 - (segment is not None)
        bounds = [0, *starts.tolist(), len(section)]
        for piece, (begin, end) in enumerate(itertools.pairwise(bounds)):
            if segment is None or piece > 0:
                segment, number = _Segment(section[begin : begin + 1], step_ns), number + 1
            if begin == end:
                continue
            stamp_ns, q = segment.extend(section[begin:end])
            if len(stamp_ns):
                x = [channel.at(section.era, stamp_ns) for channel in channels]
                yield GridRows(number, stamp_ns, q, commands.at(stamp_ns), np.stack(x, axis=1) if x else None)
    if n_early:
        text = "joint samples before the first command"
        notes.append(Note(NoteKind.left_out, text, n_early, is_usual=True))


class _Segment:
    """A gap-free stretch: the start of its grid, the rows so far, and its last sample."""

    def __init__(self, first: Samples, step_ns: int) -> None:
        self.start_ns = self.next_ns = int(first.time_ns[0])
        self.step_ns = step_ns
        self.known = first[:0]

    @property
    def last_ns(self) -> int:
        """Time of the last sample."""
        return int(self.known.time_ns[-1])

    def extend(self, section: Samples) -> tuple[np.ndarray, np.ndarray]:
        """Add samples; return the times and positions of the rows that they complete."""
        time_ns = np.concatenate([self.known.time_ns, section.time_ns])
        value = np.concatenate([self.known.value, section.value])
        self.known = Samples(time_ns[-1:], value[-1:])
        stamp_ns = np.arange(self.next_ns, time_ns[-1] + 1, self.step_ns, dtype=np.int64)
        self.next_ns += len(stamp_ns) * self.step_ns
        # Times relative to the segment's start are exact in float64; absolute nanoseconds are not.
        since_start = (stamp_ns - self.start_ns).astype(np.float64)
        sampled = (time_ns - self.start_ns).astype(np.float64)
        columns = [np.interp(since_start, sampled, value[:, joint]) for joint in range(value.shape[1])]
        return stamp_ns, np.stack(columns, axis=1)
