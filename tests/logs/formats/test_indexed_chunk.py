"""The index of a chunk makes reading faster and must never change what is read."""

import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from pipeline.logs.formats import indexed_chunk
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.formats.mcap import file as mcap_file
from pipeline.logs.formats.rosbag1 import file as rosbag1_file
from pipeline.logs.messages.message_blocks import ReadingLedger
from pipeline.logs.messages.raw_log import NoteKind
from tests.logs.conftest import make_session, with_targets
from tests.logs.samples import foreign_bags as foreign

MESSAGE_INDEX = 7
READERS = {"a.mcap": mcap_file, "a.bag": rosbag1_file}
generated = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.fixture(scope="module")
def bags(tmp_path_factory, machine):
    folder = tmp_path_factory.mktemp("indexed")
    session = with_targets(make_session(machine, seconds=10))
    names = machine.joint_names
    foreign.write_mcap(folder / "a.mcap", foreign.messages(foreign.ROS2, session, names))
    foreign.write_rosbag1(folder / "a.bag", foreign.messages(foreign.ROS1, session, names))
    return folder


def read(path, machine):
    return read_log(find_logs(path)[0], machine)


def assert_alike(one, other):
    for field in ("joint_stamp_ns", "joint_log_time_ns", "q", "command_log_time_ns", "command"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field))
    assert one.message_counts == other.message_counts and one.notes == other.notes


@pytest.mark.parametrize("name", READERS)
def test_index_is_used_and_gives_what_the_walk_gives(bags, name, machine, monkeypatch):
    indexed = read(bags / name, machine)
    monkeypatch.setattr(READERS[name], "find_messages", lambda *_: None)
    assert_alike(indexed, read(bags / name, machine))
    monkeypatch.undo()
    calls = []
    monkeypatch.setattr(READERS[name].BlockColumns, "add", lambda *arguments: calls.append(arguments))
    assert_alike(indexed, read(bags / name, machine))
    assert not calls, "messages were walked one by one although the file has an index"


@generated
@given(data=st.data())
def test_lying_mcap_index_changes_nothing(bags, tmp_path, machine, data):
    content = bytearray((bags / "a.mcap").read_bytes())
    with (bags / "a.mcap").open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    for _ in range(data.draw(st.integers(1, 6))):
        chunk = data.draw(st.sampled_from(chunks))
        start = chunk.message_index_offsets[data.draw(st.sampled_from(sorted(chunk.message_index_offsets)))]
        assert content[start] == MESSAGE_INDEX
        n_bytes = int.from_bytes(
            content[start + 11 : start + 15], "little"
        )  # of the entries, behind the head
        content[start + 15 + data.draw(st.integers(0, n_bytes - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    assert_alike(read(path, machine), read(bags / "a.mcap", machine))


def ros1_record(fields: list[tuple[bytes, bytes]], data: bytes) -> bytes:
    header = b"".join(struct.pack("<I", len(n) + 1 + len(v)) + n + b"=" + v for n, v in fields)
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def word(number: int) -> bytes:
    return struct.pack("<I", number)


@st.composite
def ros1_chunks(draw):
    """Made-up chunks with their index: shuffled header fields, descriptions between messages, entries left out."""
    orders = [[b"op", b"conn", b"time"], [b"time", b"op", b"conn"], [b"conn", b"op", b"time", b"more"]]
    order = draw(st.sampled_from(orders))
    chunk, index = b"", {0: [], 1: []}
    for number, topic in enumerate((b"/one", b"/two")):
        description = ros1_record([(b"type", b"std_msgs/String")], b"")[4:-4]
        fields = [(b"op", b"\x07"), (b"conn", word(number)), (b"topic", topic)]
        chunk += ros1_record(fields, description)
    for _ in range(draw(st.integers(1, 12))):
        connection = draw(st.integers(0, 1))
        time = struct.pack("<II", draw(st.integers(0, 99)), draw(st.integers(0, 999_999_999)))
        values = {b"op": b"\x02", b"conn": word(connection), b"time": time, b"more": b"x=y"}
        own = draw(st.sampled_from(orders)) if draw(st.integers(0, 9)) == 0 else order
        if draw(st.integers(0, 9)) > 0:
            index[connection].append(time + word(len(chunk)))
        chunk += ros1_record([(name, values[name]) for name in own], draw(st.binary(max_size=40)))
        if draw(st.integers(0, 9)) == 0:  # a record of another kind between
            chunk += ros1_record([(b"op", b"\x06"), (b"pad", b"")], b"123")
    return chunk, index


def ros1_file(chunk: bytes, index: bytes) -> bytes:
    head = ros1_record([(b"op", b"\x03"), (b"index_pos", bytes(8))], b" " * 20)
    fields = [(b"op", b"\x05"), (b"compression", b"none"), (b"size", word(len(chunk)))]
    tail = ros1_record([(b"op", b"\x06"), (b"pad", b"")], b"")
    return b"#ROSBAG V2.0\n" + head + ros1_record(fields, chunk) + index + tail


def index_records(index: dict[int, list[bytes]]) -> bytes:
    parts = []
    for number, entries in index.items():
        fields = [
            (b"op", b"\x04"),
            (b"ver", word(1)),
            (b"conn", word(number)),
            (b"count", word(len(entries))),
        ]
        parts.append(ros1_record(fields, b"".join(entries)))
    return b"".join(parts)


def found(path):
    """All that the reader gives: messages by topic, counts, notes."""
    ledger = ReadingLedger(path)
    messages = [
        (block.topic.name, time_ns, block.data[start : start + length].tobytes())
        for block in rosbag1_file.read_rosbag1(path, ledger, {"/one", "/two"})
        for time_ns, start, length in zip(
            block.log_time_ns.tolist(), block.start.tolist(), block.length.tolist(), strict=True
        )
    ]
    return messages, ledger.counts, ledger.topics, ledger.notes


def damaged(draw, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(changed) - 1))
        changed[at] ^= 1 << draw(st.integers(0, 7))
    return bytes(changed)


@generated
@given(made=ros1_chunks(), data=st.data())
def test_any_ros1_index_gives_what_the_walk_gives(tmp_path, made, data):
    """Indexes that are true, incomplete or damaged, over whole chunks."""
    chunk, index = made
    records = index_records(index)
    if data.draw(st.booleans()):
        records = damaged(data.draw, records)
    path = tmp_path / "a.bag"
    path.write_bytes(ros1_file(chunk, records))
    result = found(path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rosbag1_file, "find_messages", lambda *_: None)
        walked = found(path)
    # A damaged head of an index record is noted by both; what is read of the chunk is the same.
    assert result == walked
    assert len(result[0]) == chunk.count(b"op=\x02")


@generated
@given(made=ros1_chunks(), data=st.data())
def test_damaged_ros1_chunk_gives_what_walking_on_at_true_entries_gives(tmp_path, made, data):
    chunk, index = made
    path = tmp_path / "a.bag"
    path.write_bytes(ros1_file(damaged(data.draw, chunk), index_records(index)))
    result = found(path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(indexed_chunk, "_between", lambda *_: None)
        assert found(path) == result
        patch.setattr(rosbag1_file, "find_messages", lambda *_: None)
        messages, counts, _, _ = found(path)
    assert set(messages) <= set(result[0])
    assert all(counts[topic] <= result[1][topic] for topic in counts)


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_flip_in_a_chunk_without_checksum_costs_one_message(tmp_path, machine, kind):
    """The walk would lose the rest of the chunk; the index tells where the next message stands."""
    session = make_session(machine, seconds=10)
    path = tmp_path / f"a.{kind}"
    if kind == "bag":
        foreign.write_rosbag1(path, foreign.messages(foreign.ROS1, session, machine.joint_names))
    else:
        entries = foreign.messages(foreign.ROS2, session, machine.joint_names)
        foreign.write_mcap(path, entries, "none", enable_crcs=False)
    content = bytearray(path.read_bytes())
    stamp = int(session.log_time_ns[250])
    if kind == "bag":
        at = content.index(b"time=" + struct.pack("<II", stamp // 10**9, stamp % 10**9)) - 4
        content[at : at + 4] = b"\xff" * 4  # the length of a field
    else:
        at = content.index(struct.pack("<Q", stamp)) - 6 - 8
        content[at : at + 8] = b"\xff" * 8
    path.write_bytes(content)
    raw = read(path, machine)
    np.testing.assert_array_equal(raw.joint_log_time_ns, np.delete(session.log_time_ns, 250))
    (note,) = raw.notes
    assert note.kind is NoteKind.damage and "are lost" in note.text


@pytest.mark.parametrize("name", READERS)
def test_index_at_the_end_that_points_beyond_the_file(bags, tmp_path, machine, name):
    """Looked up behind damage, its places lie outside the file."""
    content = bytearray((bags / name).read_bytes())
    if name == "a.mcap":
        with (bags / name).open("rb") as stream:
            starts = [chunk.chunk_start_offset for chunk in make_reader(stream).get_summary().chunk_indexes]
        marks = [struct.pack("<Q", start) for start in starts]
    else:
        marks = [
            content[at - 4 : at + 18] for at in range(len(content)) if content.startswith(b"chunk_pos=", at)
        ]
        starts = [struct.unpack("<Q", mark[14:])[0] for mark in marks]
    for mark in marks:
        at = content.rindex(mark) + len(mark) - 8
        content[at : at + 8] = struct.pack("<Q", (1 << 63) + 5)
    content[starts[2] : starts[2] + 9] = b"\xee" * 9
    (tmp_path / name).write_bytes(content)
    raw = read(tmp_path / name, machine)
    whole = read(bags / name, machine)
    assert 0 < len(raw.q) < len(whole.q)
    np.testing.assert_array_equal(raw.q, whole.q[: len(raw.q)])
    assert f"byte {starts[2]}: " in raw.notes[0].text and "bytes are lost" in raw.notes[0].text
