"""What every bag format is read into: blocks of undecoded messages of one topic, at most one chunk at a time.

A storage reader (`mcap_file`, `rosbag1_file`, `sqlite3_file`) yields blocks; what the messages mean is
decided later and alike for all formats, and memory is bounded by the largest chunk.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from pipeline.logs.raw_log import Note, NoteKind


@dataclass(frozen=True)
class Topic:
    """A topic as the bag describes it.

    Attributes:
        name: Topic name.
        type_name: Message type in its full form, such as `sensor_msgs/msg/JointState`.
        encoding: Serialisation, `cdr` or `ros1`.
        definition: Text of the message definition, empty where the bag carries none.
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
        log_time_ns: When each was recorded, shape (n,), int64.
        data: Bytes that hold the messages, shape (n_bytes,), uint8.
        start: Where each message starts in `data`, shape (n,), int64.
        length: Length of each message in bytes, shape (n,), int64.
    """

    topic: Topic
    log_time_ns: np.ndarray
    data: np.ndarray
    start: np.ndarray
    length: np.ndarray


@dataclass
class ReadingLedger:
    """What was met while a bag was read: topics, message counts and notes on damage."""

    path: Path
    topics: dict[str, list[Topic]] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    notes: list[Note] = field(default_factory=list)

    def add_topic(self, topic: Topic) -> None:
        """Remember a topic; a name with several types is remembered with all of them."""
        known = self.topics.setdefault(topic.name, [])
        if topic not in known:
            known.append(topic)
        self.counts.setdefault(topic.name, 0)

    def count(self, topic: Topic, n: int) -> None:
        """Count messages of a topic."""
        self.counts[topic.name] += n

    def damage(self, offset: int | None, lost: str, count: int = 1) -> None:
        """Note damage at a byte offset of the file, and what was lost by it."""
        place = self.path.name if offset is None else f"{self.path.name}, byte {offset}"
        self.notes.append(Note(NoteKind.damage, f"{place}: {lost}", count))


class StorageReader(Protocol):
    """Reads one file of one bag format."""

    def __call__(
        self, path: Path, ledger: ReadingLedger, wanted: Collection[str], /
    ) -> Iterator[MessageBlock]:
        """Yield blocks of the wanted topics in file order; topics, counts and damage go into the ledger.

        Raises:
            InputError: The file cannot be opened or is not of this format.
        """
        ...
