"""Channels on the grid: the last value at or before a row, for as long as the channel's configuration lets it hold."""

from collections.abc import Iterator

import numpy as np

from pipeline.logs.conditioning.clocks import count_unset
from pipeline.logs.conditioning.command_rules import HeldCommands, keep_first_unset
from pipeline.logs.conditioning.ordering import sort_by_time, split_at_steps_back
from pipeline.logs.conditioning.samples import Samples
from pipeline.logs.conditioning.stray_stamps import drop_stray_stamps
from pipeline.logs.messages.columns import sections
from pipeline.logs.messages.raw_log import NANOSECONDS, ChannelSamples, Note, NoteKind, RawLog
from pipeline.machine.specification import MachineSpecification


class HeldChannel:
    """A channel's value at ascending times; NaN before its first sample and where it is older than it may hold.

    Samples that are not finite are left out. Steps of the clock back begin eras, as those of commands do.
    """

    def __init__(
        self, name: str, found: ChannelSamples, hold_s: float, gap_ns: int, section_rows: int | None
    ) -> None:
        self.name = name
        self.hold_ns = hold_s * NANOSECONDS
        self.notes: list[Note] = []
        what = f"channel {name}"
        stream = self._finite(found, section_rows)
        if count_unset(found.time_ns, gap_ns):
            stream = keep_first_unset(stream, what, "time", self.notes)
        stream = drop_stray_stamps(stream, gap_ns, what, "time", self.notes)
        stream = sort_by_time(split_at_steps_back(stream, gap_ns), gap_ns, what, "time", self.notes)
        self.held = HeldCommands(stream)

    def at(self, era: int, time_ns: np.ndarray) -> np.ndarray:
        """Return the value at times of one era, shape (n,)."""
        value = np.full(len(time_ns), np.nan)
        first_ns = self.held.begin(era)
        if first_ns is None:
            return value
        n_before = int(np.searchsorted(time_ns, first_ns))
        if n_before < len(time_ns):
            held, since_ns = self.held.at(time_ns[n_before:]).T
            is_fresh = time_ns[n_before:] - since_ns <= self.hold_ns
            value[n_before:] = np.where(is_fresh, held, np.nan)
        return value

    def finish(self, n_eras: int, notes: list[Note]) -> bool:
        """Read to the end and hand on the notes; return whether the channel's eras are those of the joint samples."""
        n_own = self.held.finish()
        notes += self.notes
        if n_own in (0, n_eras):
            return True
        text = f"channel {self.name}: its clock steps back {n_own - 1} times, the joint samples' {n_eras - 1} times"
        notes.append(Note(NoteKind.left_out, text))
        return False

    def _finite(self, found: ChannelSamples, section_rows: int | None) -> Iterator[Samples]:
        """Yield value and time, the latter as a value too so that it can be held."""
        n_strange = 0
        for time_ns, value in sections((found.time_ns, found.value), n_rows=section_rows):
            finite = np.isfinite(value)
            n_strange += len(value) - int(finite.sum())
            yield Samples(time_ns, np.stack([value, time_ns.astype(np.float64)], axis=1))[finite]
        if n_strange:
            text = f"values of channel {self.name} that are not numbers"
            self.notes.append(Note(NoteKind.left_out, text, n_strange, is_usual=True))


def held_channels(
    raw: RawLog, machine: MachineSpecification, gap_ns: int, section_rows: int | None
) -> list[HeldChannel]:
    """Return the machine's channels in order; one that the log lacks holds nothing."""
    nothing = ChannelSamples(np.zeros(0, np.int64), np.zeros(0))
    return [
        HeldChannel(
            channel.name, raw.channels.get(channel.name, nothing), channel.hold_s, gap_ns, section_rows
        )
        for channel in machine.channels
    ]
