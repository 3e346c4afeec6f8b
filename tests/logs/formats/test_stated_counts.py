"""What a file says of itself is held against what was read; records of unknown kinds are skipped by their length."""

import struct
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.configuration.load import load_machine
from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.messages.raw_log import NoteKind, RawLog
from tests.logs.damage.case import flipped
from tests.logs.samples.whole_logs import (
    MCAP,
    MCAP_CHUNKED,
    MCAP_UNCHUNKED,
    ROS1,
    WholeLog,
    whole_log,
)

FOOTER, CHUNK, MESSAGE_INDEX, STATISTICS, DATA_END = 2, 6, 7, 11, 15
generated = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def read(path: Path) -> RawLog:
    return read_log(find_logs(path)[0], load_machine("bobcat_e10"))


def n_read(raw: RawLog) -> int:
    return len(raw.q) + len(raw.command)


def damage(raw: RawLog) -> str:
    return "\n".join(note.text for note in raw.notes if note.kind is NoteKind.damage)


def with_byte(content: bytes, at: int, value: int) -> bytes:
    return content[:at] + bytes([value]) + content[at + 1 :]


def without_summary(log: WholeLog) -> bytes:
    """The bytes that a crashed or streaming recorder leaves."""
    return log.content[: log.first(DATA_END).start]


@pytest.mark.parametrize("opcode", [FOOTER, MESSAGE_INDEX, DATA_END, 38, 0x86, 0])
@pytest.mark.parametrize("kind", MCAP_CHUNKED)
def test_chunk_with_another_opcode_is_read_by_the_index_and_told(tmp_path, kind, opcode):
    log = whole_log(kind)
    chunk = log.chunks[3]
    raw = read(log.write(tmp_path / "a", with_byte(log.content, chunk.start, opcode)))
    assert n_read(raw) == log.n_messages
    assert f"byte {chunk.start}: the record's opcode {opcode} is damaged" in damage(raw)


@pytest.mark.parametrize("bit", [0, 9, 20, 40, 62])
def test_chunk_with_another_length_is_read_by_the_index_and_told(tmp_path, bit):
    log = whole_log("MCAP, zstd")
    chunk = log.chunks[3]
    raw = read(log.write(tmp_path / "a", flipped(log.content, chunk.start + 1 + bit // 8, bit % 8)))
    assert n_read(raw) == log.n_messages
    assert f"byte {chunk.start}: the chunk's length" in damage(raw)


@pytest.mark.parametrize("opcode", [FOOTER, 38])
def test_chunk_with_another_opcode_and_no_summary_is_missed(tmp_path, opcode):
    """Of such a file the chunks' own indexes tell how many messages there were."""
    log = whole_log("MCAP, zstd")
    chunk = log.chunks[3]
    raw = read(log.write(tmp_path / "a", with_byte(without_summary(log), chunk.start, opcode)))
    left = log.n_messages - chunk.n_messages
    assert n_read(raw) == left
    assert f"its chunks' indexes list {log.n_messages} messages, and {left} were found" in damage(raw)


@pytest.mark.parametrize(("opcode", "number"), [(7, 0), (1, 0), (15, 0), (8, 1)])
def test_other_records_that_become_an_end_end_nothing(tmp_path, opcode, number):
    """The file's header, an index record, the end of the data and an entry of the index, each as a footer."""
    log = whole_log("MCAP, zstd")
    place = [record for record in log.records if record.opcode == opcode][number].start
    for end in (FOOTER, DATA_END):
        raw = read(log.write(tmp_path / "a", with_byte(log.content, place, end)))
        assert n_read(raw) == log.n_messages and not damage(raw)


def test_statistics_that_differ_are_told_with_both_numbers(tmp_path):
    log = whole_log("MCAP, zstd")
    at = log.first(STATISTICS).body
    raw = read(log.write(tmp_path / "a", log.content[:at] + struct.pack("<Q", 900) + log.content[at + 8 :]))
    assert n_read(raw) == log.n_messages
    assert damage(raw) == f"a.mcap: its statistics state 900 messages, and {log.n_messages} were found"


def test_zeroed_chunk_header_is_told(tmp_path):
    log = whole_log("MCAP")
    chunk = log.chunks[3]
    for begin in (chunk.start, chunk.start + 9):
        content = log.content[:begin] + bytes(chunk.data - begin) + log.content[chunk.data :]
        raw = read(log.write(tmp_path / "a", content))
        left = log.n_messages - chunk.n_messages
        assert n_read(raw) >= left
        assert f"its statistics state {log.n_messages} messages, and {left} were found" in damage(raw)


def private_records(log: WholeLog, opcode: int, bodies: tuple[bytes, ...]) -> bytes:
    """The data section with records of an unknown kind before each record, outside of chunks."""
    extra = b"".join(struct.pack("<BQ", opcode, len(body)) + body for body in bodies)
    end = log.first(DATA_END).start
    parts = [log.content[:8]]
    for record in log.records:
        if record.start < end:
            parts += [extra, log.content[record.start : record.end]]
    return b"".join(parts)


@pytest.mark.parametrize("opcode", [0x10, 0x7F, 0x80, 0xFF])
@pytest.mark.parametrize("kind", [*MCAP_CHUNKED, MCAP_UNCHUNKED])
def test_private_and_future_records_are_skipped(tmp_path, kind, opcode):
    """The specification leaves opcodes 0x10 to 0x7F to later versions, and 0x80 to 0xFF to anybody."""
    log = whole_log(kind)
    raw = read(log.write(tmp_path / "a", private_records(log, opcode, (b"", b"private", bytes(5000)))))
    assert n_read(raw) == log.n_messages
    assert "without MCAP's end mark" in damage(raw) and "lost" not in damage(raw)


@pytest.mark.parametrize("has_index", [True, False])
def test_private_records_in_chunks_are_skipped(tmp_path, has_index):
    log = whole_log("MCAP")
    chunk, extra = log.chunks[3], struct.pack("<BQ", 0x80, 3) + b"own"
    size = chunk.end - chunk.data + len(extra)
    head = bytearray(log.content[chunk.start : chunk.data])
    head[1:9] = struct.pack("<Q", len(head) - 9 + size)
    head[25:37] = struct.pack("<QI", size, 0)
    head[-8:] = struct.pack("<Q", size)
    body = log.content[chunk.data : chunk.end] + extra
    end = log.first(DATA_END).start if has_index else log.chunks[4].start
    index = log.content[chunk.end : log.chunks[4].start] if has_index else b""
    content = log.content[: chunk.start] + bytes(head) + body + index + log.content[log.chunks[4].start : end]
    raw = read(log.write(tmp_path / "a", content))
    expected = log.n_messages if has_index else sum(part.n_messages for part in log.chunks[:4])
    assert n_read(raw) == expected and "lost" not in damage(raw)


@pytest.mark.parametrize("opcode", [4, 6, 13, 0])
@pytest.mark.parametrize("kind", ROS1)
def test_ros1_chunk_with_another_opcode_is_read_by_its_fields_and_told(tmp_path, kind, opcode):
    log = whole_log(kind)
    chunk = log.chunks[3]
    at = log.content.index(b"op=", chunk.start) + 3
    raw = read(log.write(tmp_path / "a", with_byte(log.content, at, opcode)))
    assert n_read(raw) == log.n_messages
    assert f"byte {chunk.start}: the record's opcode {opcode} is damaged" in damage(raw)


def test_ros1_counts_that_differ_are_told_with_both_numbers(tmp_path):
    """A message record that becomes one of another kind is skipped; index and messages then differ."""
    log = whole_log("ROS 1")
    at = log.content.index(b"op=\x02", log.chunks[3].data) + 3
    raw = read(log.write(tmp_path / "a", with_byte(log.content, at, 6)))
    assert n_read(raw) == log.n_messages - 1
    assert f"its index states {log.n_messages} messages, and {log.n_messages - 1} were found" in damage(raw)


@pytest.mark.parametrize("kind", [*(kind for kind in MCAP if kind != MCAP_UNCHUNKED), *ROS1])
@generated
@given(data=st.data())
def test_no_flip_in_a_records_head_is_silent(tmp_path, kind, data):
    """All messages are read, or a line tells of damage."""
    log = whole_log(kind)
    record = data.draw(st.sampled_from(log.records))
    at = data.draw(st.integers(record.start, min(record.body, record.start + 80) - 1))
    path = log.write(tmp_path / "a", flipped(log.content, at, data.draw(st.integers(0, 7))))
    try:
        raw = read(path)
    except InputError as error:
        assert "damage" in str(error)
        return
    assert n_read(raw) == log.n_messages or damage(raw)
