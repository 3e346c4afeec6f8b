"""The common form of all bag formats: blocks of undecoded messages of one topic, at most one chunk each.

A storage reader (`mcap`, `rosbag1`, `sqlite3` in `formats`) yields blocks. Messages are decoded later, in the same
way for all formats, and memory is bounded by the largest chunk.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from pipeline.logs.messages.notes import NoteList
from pipeline.logs.messages.raw_log import Note, NoteKind

MAXIMUM_TIME_NS = 1 << 62  # the year 2116; later times are damage, and differences of times stay within int64


@dataclass(frozen=True)
class LoggedTopic:
    """A topic as the bag describes it.

    Attributes:
        name: Topic name.
        type_name: Message type in its full form, such as `sensor_msgs/msg/JointState`.
        encoding: Serialisation, `cdr` or `ros1`.
        definition: Text of the message definition; empty if the bag lacks it.
        definition_format: `ros1msg`, `ros2msg` or `ros2idl`.
    """

    name: str
    type_name: str
    encoding: str
    definition: str = ""
    definition_format: str = ""


@dataclass(frozen=True)
class MessageBlock:
    """Undecoded messages of one topic.

    Attributes:
        topic: Their topic.
        log_time_ns: Log time of each message, shape (n,), int64.
        data: Bytes that hold the messages, shape (n_bytes,), uint8.
        start: Where each message starts in `data`, shape (n,), int64.
        length: Length of each message in bytes, shape (n,), int64.
    """

    topic: LoggedTopic
    log_time_ns: np.ndarray
    data: np.ndarray
    start: np.ndarray
    length: np.ndarray


@dataclass
class ReadingLedger:
    """Record of reading a bag: topics, message counts and notes on damage."""

    path: Path
    topics: dict[str, list[LoggedTopic]] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    notes: list[Note] = field(default_factory=NoteList)

    def add_topic(self, topic: LoggedTopic) -> None:
        """Add a topic; a name with several types is kept with all of them."""
        known = self.topics.setdefault(topic.name, [])
        if topic not in known:
            known.append(topic)
        self.counts.setdefault(topic.name, 0)

    def count(self, topic: LoggedTopic, n: int) -> None:
        """Count messages of a topic."""
        self.counts[topic.name] += n

    def damage(self, offset: int | None, lost: str, count: int = 1) -> None:
        """Note damage at a byte offset of the file, and the loss."""
        place = self.path.name if offset is None else f"{self.path.name}, byte {offset}"
        self.notes.append(Note(NoteKind.damage, f"{place}: {lost}", count))


class BlockColumns:
    """Gathers the messages of a chunk by channel, one by one or many at once."""

    def __init__(self, data: np.ndarray) -> None:
        self.data = data
        self.found: dict[int, tuple[list[int], list[int], list[int]]] = {}
        self.found_at_once: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}

    def add(self, channel: int, log_time_ns: int, start: int, length: int) -> None:
        """Add one message."""
        columns = self.found.get(channel)
        if columns is None:
            columns = self.found[channel] = ([], [], [])
        columns[0].append(log_time_ns)
        columns[1].append(start)
        columns[2].append(length)

    def add_many(self, channel: int, log_time_ns: np.ndarray, start: np.ndarray, length: np.ndarray) -> None:
        """Add many messages of a channel in file order, before any other of the channel."""
        self.found_at_once[channel] = (log_time_ns, start, length)

    @property
    def channels(self) -> set[int]:
        """Channels with at least one message."""
        return {*self.found, *self.found_at_once}

    def blocks(
        self, topics: Mapping[int, LoggedTopic], ledger: ReadingLedger, wanted: Collection[str], offset: int
    ) -> Iterator[MessageBlock]:
        """Count the messages of all channels and yield a block for each wanted topic."""
        for channel in sorted(self.channels):
            log_time, start, length = self._columns(channel)
            topic = topics.get(channel)
            if topic is None:
                lost = f"{len(start)} messages in the chunk that starts here are of a channel never described"
                ledger.damage(offset, lost, len(start))
                continue
            ledger.count(topic, len(start))
            if topic.name in wanted:
                possible = log_time <= MAXIMUM_TIME_NS
                if n_impossible := len(start) - int(possible.sum()):
                    lost = f"{n_impossible} messages of {topic.name} in this chunk have impossible times"
                    ledger.damage(offset, lost, n_impossible)
                    log_time, start, length = log_time[possible], start[possible], length[possible]
                yield MessageBlock(topic, log_time.astype(np.int64), self.data, start, length)

    def _columns(self, channel: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return unsigned log times, starts and lengths in file order, each of shape (n,)."""
        parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        if channel in self.found_at_once:
            parts.append(self.found_at_once[channel])
        if channel in self.found:
            log_time, start, length = self.found[channel]
            parts.append(
                (np.array(log_time, np.uint64), np.array(start, np.int64), np.array(length, np.int64))
            )
        if len(parts) == 1:
            return parts[0]
        joined = [np.concatenate(columns) for columns in zip(*parts, strict=True)]
        order = np.argsort(joined[1], kind="stable")
        return joined[0][order], joined[1][order], joined[2][order]


class StorageReader(Protocol):
    """Reads one file of one bag format."""

    def __call__(
        self, path: Path, ledger: ReadingLedger, wanted: Collection[str], /
    ) -> Iterator[MessageBlock]:
        """Yield blocks of the wanted topics in file order; record topics, counts and damage in the ledger.

        Raises:
            InputError: The file cannot be opened or is not of this format.
        """
        ...
