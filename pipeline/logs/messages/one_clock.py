"""Logs of formats with one time per sample (CAN, LeRobot, tables): positions, commands and channels as `RawLog`."""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.messages.columns import ColumnStore
from pipeline.logs.messages.conversion import command_conversion, position_conversion
from pipeline.logs.messages.raw_log import ChannelSamples, Note, RawLog
from pipeline.machine.specification import MachineSpecification

POSITIONS, COMMANDS = "positions", "commands"  # streams, and tables of the store


def channel_stream(name: str) -> str:
    """The stream of a channel."""
    return f"channel_{name}"


class OneClockLog:
    """Gathers the streams of a log block by block."""

    def __init__(self, machine: MachineSpecification, store: ColumnStore) -> None:
        self.store = store
        self.channel_names = machine.channel_names
        self.conversions = {POSITIONS: position_conversion(machine), COMMANDS: command_conversion(machine)}

    def add(
        self, stream: str, time_ns: np.ndarray, numbers: np.ndarray, has_time: np.ndarray | bool = True
    ) -> np.ndarray:
        """Convert and store the rows that hold a time and a number, and return which these are, shape (n,), bool.

        Args:
            stream: One of the above.
            time_ns: Shape (n,), int64.
            numbers: As recorded, shape (n, n_joint), of a channel (n, 1); NaN where there is none.
            has_time: Which rows have a time, shape (n,), bool.
        """
        chosen = has_time & ~np.isnan(numbers).all(axis=1)
        value = self.conversions.get(stream, np.ravel)(numbers[chosen])
        self.store.append(stream, {"time_ns": time_ns[chosen], "value": value})
        return chosen

    def finish(
        self,
        name: str,
        path: Path,
        message_counts: dict[str, int],
        notes: Iterable[Note],
        refusal: Callable[[str], str],
    ) -> RawLog:
        """Return the log.

        Args:
            name: Of the log.
            path: Where it was read.
            message_counts: Of all messages.
            notes: Damage, losses and irregularities.
            refusal: Says why there are no positions, or no commands.

        Raises:
            InputError: There are none.
        """
        streams = (POSITIONS, COMMANDS, *map(channel_stream, self.channel_names))
        found = {stream: self.store.columns(stream) for stream in streams}
        found = {stream: columns for stream, columns in found.items() if columns and len(columns["time_ns"])}
        for stream in (POSITIONS, COMMANDS):
            if stream not in found:
                raise InputError(refusal(stream))
        sampled, commanded = found[POSITIONS], found[COMMANDS]
        return RawLog(
            name=name,
            path=path,
            joint_stamp_ns=sampled["time_ns"],
            joint_log_time_ns=sampled["time_ns"],
            q=sampled["value"],
            command_log_time_ns=commanded["time_ns"],
            command=commanded["value"],
            message_counts=message_counts,
            notes=tuple(notes),
            channels={
                channel: ChannelSamples(columns["time_ns"], columns["value"])
                for channel in self.channel_names
                if (columns := found.get(channel_stream(channel)))
            },
        )
