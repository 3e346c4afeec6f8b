"""Files that are made to take minutes or gigabytes, and end in seconds; what is readable in them is read."""

import sqlite3
import struct
import time
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path

import pytest
import zstandard
from mcap.writer import CompressionType, Writer

from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.formats.sqlite3.connection import read_only
from tests.logs.damage.case import DamageCase, Damaged, Where
from tests.logs.damage.outcome import Outcome, outcomes
from tests.logs.samples import foreign_bags as foreign
from tests.logs.samples.whole_logs import entries_of, whole_log

MAXIMUM_PROCESSOR_S = 10.0
MAXIMUM_GROWTH_BYTES = 512 << 20
BOMB_BYTES = 100 << 20
SPARSE_BYTES = 3 << 30
MIB = 1 << 20


def record(opcode: int, body: bytes, length: int | None = None) -> bytes:
    return struct.pack("<BQ", opcode, len(body) if length is None else length) + body


def repeated(piece: bytes, n_bytes: int) -> bytes:
    """So many bytes of one piece over and over, compressed."""
    compressor = zstandard.ZstdCompressor().compressobj(size=n_bytes // len(piece) * len(piece))
    n, block = n_bytes // len(piece), piece * 4096
    parts = [compressor.compress(block) for _ in range(n // 4096)]
    return b"".join([*parts, compressor.compress(piece * (n % 4096)), compressor.flush()])


def with_bomb(path: Path, piece: bytes, n_bytes: int = BOMB_BYTES) -> Path:
    """A log whose first chunk is a bomb of one record over and over; without an index."""
    size = n_bytes // len(piece) * len(piece)
    content = repeated(piece, n_bytes)
    body = struct.pack("<QQQII", 0, 0, size, 0, 4) + b"zstd" + struct.pack("<Q", len(content)) + content
    log = whole_log("MCAP, zstd")
    first, end = log.chunks[0].start, max(chunk.end for chunk in log.chunks)
    path.write_bytes(log.content[:first] + record(6, body) + log.content[first:end])
    return path


def bomb_of_channels(folder: Path) -> Path:
    return with_bomb(folder / "a.mcap", record(4, b"\xff" * 5))


def bomb_of_headers(folder: Path) -> Path:
    return with_bomb(folder / "a.mcap", record(1, b""))


def bomb_of_private_records(folder: Path) -> Path:
    return with_bomb(folder / "a.mcap", record(0x99, b""))


def bomb_of_messages(folder: Path) -> Path:
    message = record(5, struct.pack("<HIQQ", 1, 0, 10, 10))
    return with_bomb(folder / "a.mcap", message, 4 * BOMB_BYTES)


def mcap_of(path: Path, definition: str, messages: Iterable[bytes], n_schemas: int = 1) -> Path:
    """The recorded log, and behind it further messages on its topic of joint states, with definitions of their own."""
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=MIB, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="test")
        known, entries = {}, entries_of(foreign.ROS2)
        for time_ns, topic, message in entries:
            if topic not in known:
                text, _ = foreign.ROS2.generate_msgdef(message.__msgtype__, ros_version=2)
                schema = writer.register_schema(message.__msgtype__, "ros2msg", text.encode())
                known[topic] = writer.register_channel(topic, "cdr", schema)
            data = bytes(foreign.ROS2.serialize_cdr(message, message.__msgtype__))
            writer.add_message(known[topic], time_ns, data, publish_time=time_ns)
        channels = []
        for number in range(n_schemas):
            text = f"# {number}\n{definition}"
            schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", text.encode())
            channels.append(writer.register_channel("/joint_states", "cdr", schema))
        for number, message in enumerate(messages):
            at_ns = entries[-1][0] + number + 1
            writer.add_message(channels[number % n_schemas], at_ns, message, publish_time=0)
        writer.finish()
    return path


def many_definitions(folder: Path) -> Path:
    definition, _ = foreign.ROS2.generate_msgdef("sensor_msgs/msg/JointState", ros_version=2)
    return mcap_of(folder / "a.mcap", definition, [bytes(40)] * 40_000, n_schemas=40_000)


SIXTEEN_MILLION = b"\x00\x01\x00\x00" + struct.pack("<I", 16 << 20) + bytes(16 << 20)
HEADER = "std_msgs/Header header\nstring[] name\nfloat64[] position\n"
HEADER_TEXT = "=" * 80 + "\nMSG: std_msgs/Header\nuint32 n\n"


def many_empty_messages_in_a_message(folder: Path) -> Path:
    nested = "=" * 80 + "\nMSG: p/E\n\n"
    return mcap_of(folder / "a.mcap", f"p/E[] e\n{HEADER}{nested}{HEADER_TEXT}", [SIXTEEN_MILLION] * 20)


def many_small_messages_in_a_message(folder: Path) -> Path:
    nested = "=" * 80 + "\nMSG: p/E\nuint8 x\n"
    return mcap_of(folder / "a.mcap", f"p/E[] e\n{HEADER}{nested}{HEADER_TEXT}", [SIXTEEN_MILLION] * 20)


def sparse(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    with path.open("r+b") as file:
        file.truncate(SPARSE_BYTES)
    return path


def false_length(opcode: int, length: int):
    def build(folder: Path) -> Path:
        log = whole_log("MCAP without chunks")
        content = log.content[: [r.end for r in log.records if r.opcode == 5][-1]]
        return sparse(folder / "a.mcap", content + record(opcode, b"", length))

    return build


def false_length_ros1(length: int):
    def build(folder: Path) -> Path:
        log = whole_log("ROS 1")
        header = b"".join(
            struct.pack("<I", len(field)) + field
            for field in (b"op=\x02", b"conn=" + bytes(4), b"time=" + bytes(8))
        )
        head = struct.pack("<I", len(header)) + header + struct.pack("<I", length)
        return sparse(folder / "a.bag", log.content[: log.chunks[-1].end] + head)

    return build


HOSTILE = {
    "bomb of damaged channels": bomb_of_channels,
    "bomb of headers": bomb_of_headers,
    "bomb of private records": bomb_of_private_records,
    "bomb of messages": bomb_of_messages,
    "40,000 definitions of one topic": many_definitions,
    "16 million empty messages in one": many_empty_messages_in_a_message,
    "16 million small messages in one": many_small_messages_in_a_message,
    "a message of 2^40 bytes": false_length(5, 1 << 40),
    "a message of 2 GB": false_length(5, 2 << 30),
    "a schema of 2 GB": false_length(3, 2 << 30),
    "a schema of 2^40 bytes": false_length(3, 1 << 40),
    "a ROS 1 message of 2^32 bytes": false_length_ros1((1 << 32) - 1),
    "a ROS 1 message of 2 GB": false_length_ros1(2 << 30),
}


def outcome_of(build, folder: Path) -> Outcome:
    """Read the file in a process of its own, whose memory is measured."""
    path = build(folder)
    case = DamageCase("hostile", "MCAP", lambda *_: Damaged(path, 0), Where.fused, only_read=True)
    (outcome,) = outcomes([(case, Damaged(path, 0), folder / "output")])
    return outcome


@pytest.mark.long
@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_file_takes_seconds_and_is_read(name, tmp_path):
    outcome = outcome_of(HOSTILE[name], tmp_path)
    assert outcome.processor_s < MAXIMUM_PROCESSOR_S
    assert outcome.grown_bytes < MAXIMUM_GROWTH_BYTES
    assert outcome.status == 0 and outcome.lines, outcome.lines
    assert len(outcome.lines) < 30
    assert outcome.recovered >= whole_log("MCAP").n_messages


CAN_COLUMNS = "(ts, arbitration_id, extended, remote, error, dlc, data)"
ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"
TOPICS = "CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)"
MESSAGES = "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
TOPIC = "INSERT INTO topics VALUES (1, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr')"
DATABASES = {
    "CAN: a view without end": (
        "a.db",
        [
            f"CREATE TABLE frames {CAN_COLUMNS}",
            f"CREATE VIEW messages AS {ENDLESS} SELECT i * 1.0 AS ts, 5 AS arbitration_id, 0 AS extended, "
            "0 AS remote, 0 AS error, 8 AS dlc, x'00' AS data FROM n WHERE i < 0",
        ],
        "has no table messages",
    ),
    "CAN: a row of 200 MB": (
        "a.db",
        [
            f"CREATE TABLE messages {CAN_COLUMNS}",
            "INSERT INTO messages VALUES (1, 5, 0, 0, 0, 8, zeroblob(2e8))",
        ],
        "SQLite cannot read on",
    ),
    "a message of 200 MB": (
        "a.db3",
        [TOPICS, TOPIC, MESSAGES, "INSERT INTO messages VALUES (1, 1, 5, zeroblob(2e8))"],
        "none of the 1 message of /joint_states can be used",
    ),
    "a column that is computed": (
        "a.db3",
        [TOPICS, TOPIC, MESSAGES.replace("data BLOB", "data BLOB AS (zeroblob(200000000))")],
        "not a ROS 2 bag",
    ),
    "row numbers of its own": (
        "a.db3",
        [
            TOPICS,
            TOPIC,
            MESSAGES.replace("id INTEGER PRIMARY KEY", "rowid TEXT"),
            "INSERT INTO messages VALUES ('x', 1, 5, x'00')",
        ],
        "not a ROS 2 bag",
    ),
}


@pytest.mark.parametrize("name", DATABASES)
def test_hostile_databases_get_one_line(name, tmp_path, machine):
    file_name, statements, said = DATABASES[name]
    with closing(sqlite3.connect(tmp_path / file_name)) as connection, connection:
        for statement in statements:
            connection.execute(statement)
    before = time.process_time()
    with pytest.raises(InputError, match=said):
        read_log(find_logs(tmp_path)[0], machine)
    assert time.process_time() - before < 2


def test_statements_are_bounded_by_the_files_size(tmp_path):
    (tmp_path / "a.db").touch()
    endless = f"{ENDLESS} SELECT count(*) FROM n"
    with read_only((tmp_path / "a.db").as_uri(), 0, 1 << 16) as connection, pytest.raises(sqlite3.Error):
        connection.execute(endless).fetchone()
