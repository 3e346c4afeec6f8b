"""The common form of all bag formats: blocks of undecoded messages of one topic, at most one chunk each.

A storage reader (`mcap`, `rosbag1`, `sqlite3` in `formats`) yields blocks. Messages are decoded later, in the same
way for all formats, and memory is bounded by the largest chunk.
"""

import functools
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from pipeline.logs.messages.notes import NoteList
from pipeline.logs.messages.raw_log import Note, NoteKind

BYTES_AS_TEXT = "latin-1"  # how a definition of bytes stands in `LoggedTopic.definition`
MAXIMUM_TIME_NS = 1 << 62  # the year 2116; later times are damage, and differences of times stay within int64


@dataclass(frozen=True)
class LoggedTopic:
    """A topic as the bag describes it.

    Attributes:
        name: Topic name.
        type_name: Message type in its full form, such as `sensor_msgs/msg/JointState`.
        encoding: Serialisation: `cdr`, `ros1`, `json` or `protobuf`.
        definition: Text of the message definition; empty if the bag lacks it.
        definition_format: `ros1msg`, `ros2msg`, `ros2idl`, `jsonschema` or `protobuf`.
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
    """Record of reading a bag: topics, message counts and notes on damage.

    Attributes:
        path: The bag, or the file that is being read.
        topics: The descriptions of each topic by its name; several if its channels differ.
        counts: Messages of each topic.
        notes: Damage, losses and irregularities.
    """

    path: Path
    topics: dict[str, dict[LoggedTopic, None]] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    notes: list[Note] = field(default_factory=NoteList)

    def add_topic(self, topic: LoggedTopic) -> None:
        """Add a topic; a name with several types is kept with all of them."""
        self.topics.setdefault(topic.name, {})[topic] = None
        self.counts.setdefault(topic.name, 0)

    def count(self, topic: LoggedTopic, n: int) -> None:
        """Count messages of a topic."""
        self.counts[topic.name] += n

    def damage(self, offset: int | None, lost: str, count: int = 1) -> None:
        """Note damage at a byte offset of the file, and the loss."""
        place = self.path.name if offset is None else f"{self.path.name}, byte {offset}"
        self.notes.append(Note(NoteKind.damage, f"{place}: {lost}", count))

    def compare_counts(self, source: str, stated: int, n_read: int) -> None:
        """Tell of a difference between the number of messages that a file states and the number that was read.

        It is told with the last damage of the file, if that was noted.
        """
        if stated == n_read:
            return
        text, count = f"{source} {stated} messages, and {n_read} were found", abs(stated - n_read)
        last = self.notes[-1] if self.notes else None
        if last and last.kind is NoteKind.damage and last.text.startswith(self.path.name):
            self.notes[-1] = replace(last, text=f"{last.text}; {text}", count=max(count, last.count))
        else:
            self.damage(None, text, count)


def by_topic(
    channel: np.ndarray, topics: Mapping[int, LoggedTopic]
) -> Iterator[tuple[LoggedTopic | None, np.ndarray]]:
    """Group messages by topic; the channels of one topic are merged in the order of the file.

    Channels whose definitions differ in comments or blanks only count as one topic, which is the first one's.

    Args:
        channel: Channel, connection or topic number of each message, shape (n,), integers.
        topics: By channel.

    Yields:
        A topic, or None for all channels without one; and which messages are its own, shape (n_own,), ascending.
    """
    numbers = _distinct(channel)
    firsts: list[LoggedTopic | None] = []
    groups: dict[LoggedTopic | None, int] = {}
    group_of = []
    for topic in map(topics.get, numbers.tolist()):
        group_of.append(groups.setdefault(topic and _bare(topic), len(groups)))
        firsts += [topic] * (len(groups) - len(firsts))
    # NumPy sorts small integers much faster.
    group = np.array(group_of, np.min_scalar_type(len(groups)))[np.searchsorted(numbers, channel)]
    order = np.argsort(group, kind="stable")
    ends = np.cumsum(np.bincount(group, minlength=len(groups)))
    yield from zip(firsts, np.split(order, ends), strict=False)  # what remains behind the last end is empty


def _distinct(channel: np.ndarray) -> np.ndarray:
    """Return the distinct numbers, ascending."""
    # NumPy finds them among small integers three times faster.
    return np.unique(channel.astype(np.min_scalar_type(channel.max(initial=0)), copy=False))


@functools.lru_cache(maxsize=1024)
def _bare(topic: LoggedTopic) -> LoggedTopic:
    """Return a topic whose definition has no comments and no blanks beside what it defines."""
    if topic.definition_format not in ("ros1msg", "ros2msg"):
        return topic
    lines = (" ".join(line.partition("#")[0].split()) for line in topic.definition.splitlines())
    return replace(topic, definition="\n".join(line for line in lines if line))


class BlockColumns:
    """Gathers the messages of a chunk, one by one or many at once."""

    def __init__(self, data: np.ndarray) -> None:
        self.data = data
        self.walked: list[tuple[int, int, int, int]] = []
        self.indexed: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []

    def add(self, channel: int, log_time_ns: int, start: int, length: int) -> None:
        """Add one message."""
        self.walked.append((channel, log_time_ns, start, length))

    def add_many(
        self, channel: np.ndarray, log_time_ns: np.ndarray, start: np.ndarray, length: np.ndarray
    ) -> None:
        """Add many messages."""
        self.indexed.append((channel, log_time_ns, start, length))

    def clear(self) -> None:
        """Forget all messages."""
        self.walked, self.indexed = [], []

    def __len__(self) -> int:
        return len(self.walked) + sum(len(channel) for channel, *_ in self.indexed)

    @property
    def channels(self) -> set[int]:
        """Channels with at least one message."""
        found = {channel for channel, *_ in self.walked}
        return found.union(*(_distinct(channel).tolist() for channel, *_ in self.indexed))

    def in_file_order(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return channels, unsigned log times, starts and lengths in the order of the file, each of shape (n,)."""
        types = (np.int64, np.uint64, np.int64, np.int64)
        parts = [*self.indexed]
        if self.walked or not parts:
            rows = zip(*self.walked, strict=True) if self.walked else [()] * len(types)
            channel, log_time, start, length = map(np.array, rows, types)
            parts.append((channel, log_time, start, length))
        if len(parts) == 1:
            return parts[0]
        joined = [np.concatenate(columns) for columns in zip(*parts, strict=True)]
        order = np.argsort(joined[2], kind="stable")
        channel, log_time, start, length = (column[order] for column in joined)
        return channel, log_time, start, length

    def blocks(
        self,
        topics: Mapping[int, LoggedTopic],
        ledger: ReadingLedger,
        wanted: Container[str],
        offset: int,
    ) -> Iterator[MessageBlock]:
        """Count the messages of all channels and yield a block for each wanted topic."""
        channels, log_times, starts, lengths = self.in_file_order()
        for topic, own in by_topic(channels, topics):
            if topic is None:
                lost = f"{len(own)} messages in the chunk that starts here are of a channel never described"
                ledger.damage(offset, lost, len(own))
                continue
            ledger.count(topic, len(own))
            if topic.name in wanted:
                log_time, start, length = log_times[own], starts[own], lengths[own]
                possible = log_time <= MAXIMUM_TIME_NS
                if n_impossible := len(start) - int(possible.sum()):
                    lost = f"{n_impossible} messages of {topic.name} in this chunk have impossible times"
                    ledger.damage(offset, lost, n_impossible)
                    log_time, start, length = log_time[possible], start[possible], length[possible]
                yield MessageBlock(topic, log_time.astype(np.int64), self.data, start, length)


class StorageReader(Protocol):
    """Reads one file of one bag format."""

    def __call__(
        self, path: Path, ledger: ReadingLedger, wanted: Container[str], /
    ) -> Iterator[MessageBlock]:
        """Yield blocks of the wanted topics in file order; record topics, counts and damage in the ledger.

        Raises:
            InputError: The file cannot be opened or is not of this format.
        """
        ...
