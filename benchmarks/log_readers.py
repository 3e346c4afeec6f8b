"""What this project's readers of MCAP files and ROS 1 bags gain over the formats' libraries, read in blocks.

    python -m benchmarks.log_readers            # some 100 MB each; user time in seconds, three times each
    python -m benchmarks.log_readers mcap       # or bag: of one format alone

Both ways end in the same blocks of undecoded messages. `walk` is this project's reader without the chunks' indexes.
"""

import itertools
import resource
import sys
import tempfile
import unittest.mock
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from rosbags.rosbag1 import Reader

from pipeline.configuration.load import load_machine
from pipeline.logs.formats.mcap import file as mcap_file
from pipeline.logs.formats.rosbag1 import file as rosbag1_file
from pipeline.logs.messages.message_blocks import LoggedTopic, MessageBlock, ReadingLedger
from tests.logs.conftest import make_session
from tests.logs.samples import foreign_bags as foreign

WANTED = ("/joint_states", "/joint_commands")
SECONDS = 3600
COPIES = 3  # of each message, so that a file has some 100 MB
BLOCK = 4096
REPEATS = 3
Message = tuple[LoggedTopic, int, bytes]


def blocks_of(messages: Iterator[Message]) -> Iterator[MessageBlock]:
    while batch := list(itertools.islice(messages, BLOCK)):
        for topic in {topic for topic, _, _ in batch}:
            own = [(time_ns, data) for other, time_ns, data in batch if other is topic]
            length = np.array([len(data) for _, data in own])
            data = np.frombuffer(b"".join(data for _, data in own), np.uint8)
            times = np.array([time_ns for time_ns, _ in own])
            yield MessageBlock(topic, times, data, np.cumsum(length) - length, length)


def mcap_library(path: Path) -> Iterator[Message]:
    topics: dict[int, LoggedTopic] = {}
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(WANTED, log_time_order=False):
            topic = topics.setdefault(channel.id, LoggedTopic(channel.topic, "", "cdr"))
            yield topic, message.log_time, message.data


def rosbags_library(path: Path) -> Iterator[Message]:
    topics: dict[int, LoggedTopic] = {}
    with Reader(path) as reader:
        for connection, time_ns, data in reader.messages():
            yield topics.setdefault(connection.id, LoggedTopic(connection.topic, "", "ros1")), time_ns, data


def user_s(read: Callable[[], Iterator[MessageBlock]]) -> tuple[float, int]:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    n_messages = sum(len(block.start) for block in read())
    return resource.getrusage(resource.RUSAGE_SELF).ru_utime - before, n_messages


def compare(kind: str) -> None:
    """Write a file, read it in every way and print the times."""
    module, library, store = {
        "mcap": (mcap_file, mcap_library, foreign.ROS2),
        "bag": (rosbag1_file, rosbags_library, foreign.ROS1),
    }[kind]
    machine = load_machine("bobcat_e10")
    once = foreign.messages(store, make_session(machine, seconds=SECONDS), machine.joint_names)
    entries = [entry for entry in once for _ in range(COPIES)]
    read = mcap_file.read_mcap if kind == "mcap" else rosbag1_file.read_rosbag1
    ways: dict[str, list[tuple[float, int]]] = {"own": [], "walk": [], "library": []}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a.{kind}"
        if kind == "mcap":
            foreign.write_mcap(path, entries, "none", chunk_bytes=768 << 10)
        else:
            foreign.write_rosbag1(path, entries, "none", chunk_bytes=768 << 10)
        for _ in range(REPEATS):
            ways["own"].append(user_s(lambda: read(path, ReadingLedger(path), WANTED)))
            with unittest.mock.patch.object(module, "find_messages", lambda *_: None):
                ways["walk"].append(user_s(lambda: read(path, ReadingLedger(path), WANTED)))
            ways["library"].append(user_s(lambda: blocks_of(library(path))))
        (n_messages,) = {n for found in ways.values() for _, n in found}
        print(f"{kind}: {path.stat().st_size / 1e6:.0f} MB, {n_messages} messages")
    for way, found in ways.items():
        print(way, *(f"{seconds:.2f}" for seconds, _ in found))


if __name__ == "__main__":
    for name in sys.argv[1:] or ("mcap", "bag"):
        compare(name)
