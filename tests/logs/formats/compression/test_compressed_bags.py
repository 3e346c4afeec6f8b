"""Bags that `ros2 bag record` compressed: as files or message by message."""

import bz2
import errno
import shutil
import sqlite3
import tempfile
from collections import namedtuple

import lz4.frame
import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.compression import compressed_file
from pipeline.logs.formats.compression.bounded_decompression import DecompressionError, decompress
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.messages.raw_log import NoteKind
from tests.logs.conftest import make_session
from tests.logs.formats.test_formats import assert_holds
from tests.logs.samples import foreign_bags as foreign

STORAGES = [StoragePlugin.SQLITE3, StoragePlugin.MCAP]
MODES = [CompressionMode.FILE, CompressionMode.MESSAGE]


@pytest.fixture(scope="module")
def short(machine):
    return make_session(machine, seconds=12)


@pytest.fixture(scope="module")
def entries(machine, short):
    return foreign.messages(foreign.ROS2, short, machine.joint_names)


def read(path, machine):
    (entry,) = find_logs(path)
    return read_log(entry, machine)


@pytest.fixture(autouse=True)
def nothing_is_left(tmp_path_factory, monkeypatch):
    """Temporary copies are gone afterwards, whatever happened."""
    folder = tmp_path_factory.mktemp("temporary")
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    yield
    assert not list(folder.iterdir())


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("with_metadata", [True, False])
def test_compressed_bags(tmp_path, machine, short, entries, storage, mode, with_metadata):
    folder = foreign.write_rosbag2(tmp_path / "run", entries, storage, compression=mode)
    assert len(list(folder.glob("*.zstd"))) == (mode is CompressionMode.FILE)
    if not with_metadata:
        (folder / "metadata.yaml").unlink()
    assert_holds(read(tmp_path, machine), short)
    if mode is CompressionMode.FILE:
        (file,) = folder.glob("*.zstd")
        assert_holds(read(file, machine), short)


def test_split_and_half_compressed_bag(tmp_path, machine, short, entries):
    """The recorder was killed while it compressed: the second file is there twice, the last one plain."""
    third = len(entries) // 3
    folder = tmp_path / "run"
    for number in range(3):
        part = entries[number * third : (number + 1) * third if number < 2 else None]
        foreign.write_mcap(folder / f"run_{number}.mcap", part)
    for number in range(2):
        plain = folder / f"run_{number}.mcap"
        compressed = zstandard.compress(plain.read_bytes())
        (folder / f"run_{number}.mcap.zstd").write_bytes(compressed if number == 0 else compressed[:100])
        if number == 0:
            plain.unlink()
    copy = "run/run_1.mcap.zstd is a copy of a file of this log, or a link to one, and is not read"
    assert_holds(read(tmp_path, machine), short, notes=[copy])
    listing = "".join(f"\n  - run_{number}.mcap.zstd" for number in range(3))
    text = f"rosbag2_bagfile_information:\n  relative_file_paths:{listing}\n"
    (folder / "metadata.yaml").write_text(text)
    (folder / "run_1.mcap.zstd").unlink()
    assert_holds(read(tmp_path, machine), short)


def test_other_compression_is_named(tmp_path, machine, entries):
    folder = foreign.write_rosbag2(tmp_path / "run", entries, compression=CompressionMode.FILE)
    metadata = folder / "metadata.yaml"
    metadata.write_text(
        metadata.read_text().replace("compression_format: zstd", "compression_format: brotli")
    )
    with pytest.raises(InputError, match=r"metadata\.yaml: the bag is compressed as brotli"):
        read(tmp_path, machine)


@pytest.fixture(scope="module")
def longer(machine):
    return make_session(machine, seconds=60)


@pytest.fixture(scope="module", params=STORAGES, ids=["sqlite3", "mcap"])
def compressed(request, tmp_path_factory, machine, longer):
    """Suffix and compressed bytes of a bag of several blocks of zstd, which are 128 KiB each."""
    folder = tmp_path_factory.mktemp("compressed") / "run"
    entries = foreign.messages(foreign.ROS2, longer, machine.joint_names)
    foreign.write_rosbag2(folder, entries, request.param, compression=CompressionMode.FILE)
    (file,) = folder.glob("*.zstd")
    return "".join(file.suffixes), file.read_bytes()


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0.0, 0.99))
def test_cut_file_gives_its_front(tmp_path, machine, longer, compressed, share):
    suffix, data = compressed
    cut = tmp_path / f"cut{suffix}"
    cut.write_bytes(data[: int(share * len(data))])
    try:
        raw = read(cut, machine)
    except InputError as error:
        assert "\n" not in str(error) and "cut" in str(error)
        assert share < 0.6, f"most of the file is there, yet: {error}"
        return
    kept = len(raw.q)
    np.testing.assert_array_equal(raw.joint_log_time_ns, longer.log_time_ns[:kept])
    np.testing.assert_array_equal(raw.q, longer.q[:kept])
    first = raw.notes[0]
    assert first.kind is NoteKind.damage and first.text.startswith(f"{cut.name}, byte ")
    assert "it ends early" in first.text
    assert kept > (share - 0.5) * len(longer.q)


def test_damaged_file_gives_what_is_before(tmp_path, machine, entries):
    """Many frames, as `zstd` or `pzstd` write them; one is damaged."""
    source = foreign.write_mcap(tmp_path / "plain.mcap", entries, "none")
    data = source.read_bytes()
    source.unlink()
    frames = [zstandard.compress(data[i : i + 10_000]) for i in range(0, len(data), 10_000)]
    (tmp_path / "a.mcap.zst").write_bytes(b"".join(frames))
    whole = read(tmp_path, machine)
    assert not whole.notes
    middle = len(frames) // 2
    frames[middle] = b"\xff" * 50
    (tmp_path / "a.mcap.zst").write_bytes(b"".join(frames))
    raw = read(tmp_path, machine)
    assert 0.3 * len(whole.q) < len(raw.q) < 0.6 * len(whole.q)
    np.testing.assert_array_equal(raw.q, whole.q[: len(raw.q)])
    assert f"the {10_000 * middle} bytes before were decompressed" in raw.notes[0].text
    assert any("a.mcap.zst (decompressed), byte" in note.text for note in raw.notes[1:])


def test_file_that_is_no_zstd(tmp_path, machine):
    (tmp_path / "a.db3.zstd").write_bytes(b"this is not compressed")
    with pytest.raises(InputError, match=r"a\.db3\.zstd: cannot be decompressed"):
        read(tmp_path, machine)
    (tmp_path / "a.db3.zstd").write_bytes(b"")
    with pytest.raises(InputError, match=r"a\.db3\.zstd: cannot be decompressed \(it ends early\)"):
        read(tmp_path, machine)


def test_bomb(tmp_path, machine, monkeypatch):
    monkeypatch.setattr(compressed_file, "ALWAYS_ALLOWED_BYTES", 1 << 20)
    (tmp_path / "a.mcap.zstd").write_bytes(zstandard.compress(bytes(1 << 26)))
    with pytest.raises(InputError, match="more than 1000 times as long"):
        read(tmp_path, machine)


def test_no_room(tmp_path, machine, entries, monkeypatch):
    foreign.write_rosbag2(tmp_path / "run", entries, compression=CompressionMode.FILE)
    usage = namedtuple("usage", "total used free")
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "disk_usage", lambda _: usage(1 << 40, 1 << 40, 1 << 20))
        with pytest.raises(InputError, match=r"no room to decompress it in .*1 MiB are free.*TMPDIR"):
            read(tmp_path, machine)

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(compressed_file, "_check_room", full)
    with pytest.raises(InputError, match=r"No space left on device\); free some room in .*TMPDIR"):
        read(tmp_path, machine)


@pytest.mark.parametrize("with_metadata", [True, False])
def test_damaged_messages_are_counted(tmp_path, machine, short, entries, with_metadata):
    folder = foreign.write_rosbag2(tmp_path / "run", entries, compression=CompressionMode.MESSAGE)
    if not with_metadata:
        (folder / "metadata.yaml").unlink()
    (database,) = folder.glob("*.db3")
    connection = sqlite3.connect(database)
    rows = connection.execute(
        "SELECT m.id, data FROM messages m JOIN topics t ON t.id = topic_id "
        "WHERE name = '/joint_states' ORDER BY m.id"
    ).fetchall()
    compressor = zstandard.ZstdCompressor().compressobj(size=600 << 20)  # more than a message may have
    bomb = b"".join(compressor.compress(bytes(1 << 20)) for _ in range(600)) + compressor.flush()
    broken = {10: b"", 20: rows[20][1][:-3], 30: b"\xff" + rows[30][1][1:], 40: bomb}
    broken[60] = zstandard.compress(bytes(100 << 20))  # ten thousand times as long
    broken[70] = zstandard.ZstdCompressor(write_content_size=False).compress(bytes(100 << 20))
    broken[50] = rows[50][1][:12] + b"\xff\xff" + rows[50][1][14:]
    for index, data in broken.items():
        connection.execute("UPDATE messages SET data = ? WHERE id = ?", (data, rows[index][0]))
    connection.commit()
    connection.close()
    raw = read(tmp_path, machine)
    lost = [index for index, t in enumerate(short.log_time_ns) if t not in raw.joint_log_time_ns]
    assert {10, 20, 30, 40, 60, 70} <= set(lost) <= set(broken)
    kept = np.delete(np.arange(len(short.q)), lost)
    sure = kept[kept != 50]  # a flipped bit in a frame without a checksum may go unnoticed
    np.testing.assert_array_equal(raw.q[np.isin(kept, sure)], short.q[sure])
    assert sum(note.count for note in raw.notes) == len(lost)
    (note,) = [note for note in raw.notes if note.kind is NoteKind.damage]
    assert "messages of /joint_states cannot be decompressed" in note.text and note.count >= 4


def test_frame_without_stated_length(tmp_path, machine, short, entries):
    """A streaming compressor does not know it."""
    folder = foreign.write_rosbag2(tmp_path / "run", entries)
    (database,) = folder.glob("*.db3")
    connection = sqlite3.connect(database)
    compressor = zstandard.ZstdCompressor(write_content_size=False)
    for number, data in connection.execute("SELECT id, data FROM messages").fetchall():
        connection.execute("UPDATE messages SET data = ? WHERE id = ?", (compressor.compress(data), number))
    connection.commit()
    connection.close()
    assert_holds(read(tmp_path, machine), short)


@pytest.mark.parametrize("compression", ["zstd", "lz4", "bz2"])
@given(content=st.binary(max_size=3000), repeat=st.sampled_from([1, 50]), share=st.floats(0, 1))
def test_chunk_decompression_never_gives_wrong_bytes(compression, content, repeat, share):
    """Whole, cut and cut unknowingly, with and without a stated length in the frame."""
    content *= repeat
    compressors = {
        "zstd": [zstandard.compress, zstandard.ZstdCompressor(write_content_size=False).compress],
        "lz4": [lz4.frame.compress],
        "bz2": [bz2.compress],
    }
    for compress in compressors[compression]:
        data = compress(content)
        assert decompress(compression, data, len(content)) == content
        assert decompress(compression, data, None) == content
        cut = data[: int(share * (len(data) - 1))]
        front = decompress(compression, cut, len(content), cut=True)
        assert content.startswith(front)
        for size in (len(content), None):
            try:
                assert decompress(compression, cut, size) == content
            except DecompressionError as error:
                assert content.startswith(error.front)
        if content:
            with pytest.raises(DecompressionError):
                decompress(compression, data, len(content) - 1)
