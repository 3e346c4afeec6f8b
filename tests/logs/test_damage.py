"""Damaged logs: what is before the damage is recovered, the note says where and what was lost, nothing else happens."""

import os
import shutil
import sqlite3

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.rosbag2 import StoragePlugin

from pipeline.errors import InputError
from pipeline.logs.bags import read_log
from pipeline.logs.discover import find_logs
from pipeline.logs.raw_log import NoteKind
from tests.logs import foreign_bags as foreign
from tests.logs.conftest import make_session

slow = settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture(scope="module")
def short(machine):
    return make_session(machine, seconds=12)


@pytest.fixture(scope="module")
def whole(tmp_path_factory, machine, short):
    """One bag of each kind, by name."""
    folder = tmp_path_factory.mktemp("whole")
    ros1 = foreign.messages(foreign.ROS1, short, machine.joint_names)
    ros2 = foreign.messages(foreign.ROS2, short, machine.joint_names)
    files = {f"{c}.bag": foreign.write_rosbag1(folder / f"{c}.bag", ros1, c) for c in ("none", "bz2", "lz4")}
    files |= {f"{c}.mcap": foreign.write_mcap(folder / f"{c}.mcap", ros2, c) for c in ("none", "lz4", "zstd")}
    files["unchunked.mcap"] = foreign.write_mcap(folder / "unchunked.mcap", ros2, chunked=False)
    (files["rosbags.mcap"],) = foreign.write_rosbag2(folder / "r", ros2, StoragePlugin.MCAP).glob("*.mcap")
    (files["sqlite.db3"],) = foreign.write_rosbag2(folder / "s", ros2).glob("*.db3")
    return files


KINDS = [
    "none.bag",
    "bz2.bag",
    "lz4.bag",
    "none.mcap",
    "lz4.mcap",
    "zstd.mcap",
    "unchunked.mcap",
    "rosbags.mcap",
]


def read(path, machine):
    (entry,) = find_logs(path)
    return read_log(entry, machine)


def subset_of(raw, session):
    """Which of the session's samples were read; each must be bit for bit one of them, in order."""
    rows = np.searchsorted(session.log_time_ns, raw.joint_log_time_ns)
    np.testing.assert_array_equal(session.log_time_ns[rows], raw.joint_log_time_ns)
    np.testing.assert_array_equal(session.q[rows], raw.q)
    np.testing.assert_array_equal(session.stamp_ns[rows], raw.joint_stamp_ns)
    assert (np.diff(rows) > 0).all()
    return rows


@pytest.mark.parametrize("kind", KINDS)
@slow
@given(share=st.floats(0, 1))
def test_cut_off_anywhere(whole, tmp_path, machine, short, kind, share):
    """A crash of the recorder: the front is read, sample by sample what was recorded."""
    data = whole[kind].read_bytes()
    cut = int(share * len(data))
    path = tmp_path / kind
    path.write_bytes(data[:cut])
    try:
        raw = read(path, machine)
    except InputError as error:
        assert "\n" not in str(error)
        assert share < 0.5, f"half of the file holds joint states and commands, yet: {error}"
        return
    np.testing.assert_array_equal(subset_of(raw, short), np.arange(len(raw.q)))
    if len(raw.q) < len(short.q):
        (note, *_) = [note for note in raw.notes if note.kind is NoteKind.damage]
        assert kind in note.text and "byte" in note.text


@pytest.mark.parametrize(
    ("kind", "recovered"), [("zstd.mcap", 0.8), ("none.bag", 0.85), ("unchunked.mcap", 0.85)]
)
def test_nine_tenths_of_a_file_give_most_of_its_samples(whole, tmp_path, machine, short, kind, recovered):
    data = whole[kind].read_bytes()
    (tmp_path / kind).write_bytes(data[: int(0.9 * len(data))])
    assert len(read(tmp_path / kind, machine).q) > recovered * len(short.q)


@slow
@given(share=st.floats(0.05, 0.95), bit=st.integers(0, 7))
@pytest.mark.parametrize("kind", ["none.mcap", "zstd.mcap", "lz4.mcap"])
def test_bit_flip_costs_one_chunk(whole, tmp_path, machine, short, kind, share, bit):
    """With checksums a flip in a chunk costs that chunk; every sample that is read was recorded."""
    data = bytearray(whole[kind].read_bytes())
    with whole[kind].open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    chunk = chunks[int(share * len(chunks))]
    data[chunk.chunk_start_offset + 60 + int(share * (chunk.chunk_length - 60))] ^= 1 << bit
    (tmp_path / kind).write_bytes(data)
    raw = read(tmp_path / kind, machine)
    lost = np.setdiff1d(np.arange(len(short.q)), subset_of(raw, short))
    times = short.log_time_ns[lost]
    assert len(lost) and (times >= chunk.message_start_time).all() and (times <= chunk.message_end_time).all()
    (note,) = [note for note in raw.notes if note.kind is NoteKind.damage]
    assert f"byte {chunk.chunk_start_offset}" in note.text


def test_damaged_record_head_skips_to_the_next_indexed_chunk(whole, tmp_path, machine, short):
    for kind in ("none.mcap", "none.bag"):
        data = bytearray(whole[kind].read_bytes())
        if kind.endswith("mcap"):
            with whole[kind].open("rb") as stream:
                at = make_reader(stream).get_summary().chunk_indexes[1].chunk_start_offset
        else:
            at = chunk_starts(bytes(data))[1]
        data[at : at + 9] = b"\xee" * 9
        (tmp_path / kind).write_bytes(data)
        raw = read(tmp_path / kind, machine)
        kept = subset_of(raw, short)
        assert 0.5 * len(short.q) < len(kept) < len(short.q) and kept[-1] == len(short.q) - 1
        assert any(f"byte {at}" in note.text for note in raw.notes)


def test_unfinished_mcap(tmp_path, machine, short):
    """The recorder was killed: no footer, the last chunk never written."""
    entries = foreign.messages(foreign.ROS2, short, machine.joint_names)
    foreign.write_mcap(tmp_path / "a.mcap", entries, finish=False)
    raw = read(tmp_path / "a.mcap", machine)
    np.testing.assert_array_equal(subset_of(raw, short), np.arange(len(raw.q)))
    assert len(raw.q) > 0.5 * len(short.q)


def test_active_ros1_bag(whole, tmp_path, machine, short):
    """`rosbag record` killed in an open chunk: its header says nothing of its length, and no index follows."""
    data = whole["none.bag"].read_bytes()
    start = chunk_starts(data)[-1]
    header_end = start + 4 + int.from_bytes(data[start : start + 4], "little")
    size_at = data.index(b"size=", start, header_end) + 5
    crashed = bytearray(data[: header_end + 4 + 5000])
    crashed[size_at : size_at + 4] = crashed[header_end : header_end + 4] = bytes(4)
    (tmp_path / "a.bag.active").write_bytes(crashed)
    (entry,) = find_logs(tmp_path)
    raw = read_log(entry, machine)
    assert entry.name == "a"
    np.testing.assert_array_equal(subset_of(raw, short), np.arange(len(raw.q)))
    (tmp_path / "closed.bag").write_bytes(data[:start])
    assert len(raw.q) > len(read(tmp_path / "closed.bag", machine).q)


def chunk_starts(data: bytes) -> list[int]:
    """Where the chunk records of a ROS 1 bag start, by walking its records."""
    starts, position = [], len(b"#ROSBAG V2.0\n")
    while position < len(data):
        header_length = int.from_bytes(data[position : position + 4], "little")
        data_at = position + 4 + header_length
        if b"op=\x05" in data[position:data_at]:
            starts.append(position)
        position = data_at + 4 + int.from_bytes(data[data_at : data_at + 4], "little")
    return starts


def test_sqlite_with_a_hot_journal(whole, tmp_path, machine, short):
    """A crash within a transaction: SQLite's rollback applies to a copy; the user's files stay as they are."""
    source = tmp_path / "live" / "a.db3"
    source.parent.mkdir()
    shutil.copy(whole["sqlite.db3"], source)
    connection = sqlite3.connect(source, isolation_level=None)
    connection.execute("PRAGMA cache_size = 1")  # so that the unfinished transaction reaches the file
    connection.execute("BEGIN")
    connection.execute("UPDATE messages SET data = zeroblob(length(data))")
    crashed = tmp_path / "crashed"
    shutil.copytree(source.parent, crashed)
    connection.execute("ROLLBACK")
    connection.close()
    before = {path.name: path.read_bytes() for path in crashed.iterdir()}
    assert before["a.db3-journal"] and before["a.db3"] != whole["sqlite.db3"].read_bytes()
    raw = read(crashed, machine)
    np.testing.assert_array_equal(raw.q, short.q)
    assert "a.db3-journal" in raw.notes[0].text
    assert {path.name: path.read_bytes() for path in crashed.iterdir()} == before


def test_sqlite_with_damaged_pages_goes_on_behind_them(whole, tmp_path, machine, short):
    data = bytearray(whole["sqlite.db3"].read_bytes())
    middle = len(data) // 2 // 4096 * 4096
    data[middle : middle + 4096] = b"\xff" * 4096
    (tmp_path / "a.db3").write_bytes(data)
    raw = read(tmp_path / "a.db3", machine)
    kept = subset_of(raw, short)
    assert 0.8 * len(short.q) < len(kept) < len(short.q) and kept[-1] == len(short.q) - 1
    assert any(note.kind is NoteKind.damage and "after row" in note.text for note in raw.notes)


@pytest.mark.parametrize("name", ["a.mcap", "a.bag", "a.db3", "a.csv", "a.parquet"])
@pytest.mark.parametrize("content", [b"", b"\x00", b"this is no log at all, whatever its name says\n" * 9])
def test_files_that_are_no_logs(tmp_path, machine, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=name) as error:
        read(tmp_path, machine)
    assert "\n" not in str(error.value)


def test_bag_without_messages(tmp_path, machine):
    foreign.write_mcap(tmp_path / "a.mcap", [])
    with pytest.raises(InputError, match=r"topic /joint_states is not in the log.*seen: none"):
        read(tmp_path, machine)


def test_bag_without_commands(tmp_path, machine, short):
    entries = [
        e for e in foreign.messages(foreign.ROS2, short, machine.joint_names) if e[1] != "/joint_commands"
    ]
    foreign.write_mcap(tmp_path / "a.mcap", entries)
    with pytest.raises(
        InputError, match=r"topic /joint_commands is not in the log.*/joint_states \(sensor_msgs"
    ):
        read(tmp_path, machine)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
@pytest.mark.parametrize("kind", ["none.mcap", "none.bag", "sqlite.db3"])
def test_no_permission(whole, tmp_path, machine, kind):
    path = tmp_path / kind
    shutil.copy(whole[kind], path)
    path.chmod(0)
    with pytest.raises(InputError, match=r"Permission denied.*check"):
        read(path, machine)


def test_file_missing_from_a_split_bag_is_noted(tmp_path, machine, short):
    entries = foreign.messages(foreign.ROS2, short, machine.joint_names)
    foreign.write_mcap(tmp_path / "run" / "run_1.mcap", entries)
    text = "rosbag2_bagfile_information: {relative_file_paths: [run_0.mcap, run_1.mcap]}"
    (tmp_path / "run" / "metadata.yaml").write_text(text)
    raw = read(tmp_path, machine)
    assert len(raw.q) == len(short.q) and "run_0.mcap" in raw.notes[0].text


def test_chunk_that_declares_more_than_it_should(whole, tmp_path, machine):
    """A length of 2^60 must not be allocated."""
    data = bytearray(whole["zstd.mcap"].read_bytes())
    with whole["zstd.mcap"].open("rb") as stream:
        at = make_reader(stream).get_summary().chunk_indexes[0].chunk_start_offset
    data[at + 9 + 16 : at + 9 + 24] = (1 << 60).to_bytes(8, "little")
    (tmp_path / "a.mcap").write_bytes(data)
    raw = read(tmp_path, machine)
    assert "1152921504606846976 bytes" in raw.notes[0].text


@slow
@given(data=st.data())
@pytest.mark.parametrize("kind", [*KINDS, "sqlite.db3"])
def test_any_damage_gives_a_log_or_one_line(whole, tmp_path, machine, kind, data):
    damaged = bytearray(whole[kind].read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(damaged) - 1))
        piece = data.draw(st.binary(min_size=1, max_size=12))
        damaged[at : at + len(piece)] = piece
    (tmp_path / kind).write_bytes(damaged)
    try:
        read(tmp_path / kind, machine)
    except InputError as error:
        assert "\n" not in str(error)
