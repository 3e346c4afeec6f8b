"""CAN logs in every format that `python-can` reads: what was recorded, whatever the frames' layout, and damage."""

import re
from dataclasses import replace

import can
import cantools
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.can.detect import is_can_log
from pipeline.logs.formats.can.merged import MergedFrames
from pipeline.logs.formats.discover import LogFormat, find_logs
from pipeline.logs.ingest import ingest
from pipeline.logs.messages.raw_log import NoteKind
from pipeline.machine.specification import CanSource, ChannelSource
from tests.logs import can_logs
from tests.logs.conftest import make_session

DELAYS_NS = (0, 1_000_000, 2_000_000, 7_000_000)
SUFFIXES = sorted(can_logs.WRITERS)


@pytest.fixture(scope="module")
def short(machine):
    return make_session(machine, seconds=6)


@pytest.fixture(scope="module")
def recorded(machine, short):
    return can_logs.frames(short, machine.joint_names)


def read(path, machine):
    (entry,) = find_logs(path)
    assert entry.format is LogFormat.can
    return read_log(entry, machine)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_was_recorded(tmp_path, machine, short, recorded, suffix):
    raw = read(can_logs.write(tmp_path / f"a{suffix}", recorded), machine)
    assert len(raw.q) == len(short.q) and len(raw.command) == len(short.command)
    np.testing.assert_allclose(raw.q, can_logs.rounded_q(short), atol=1e-12)
    np.testing.assert_array_equal(raw.command, short.command)
    np.testing.assert_array_equal(raw.joint_stamp_ns, raw.joint_log_time_ns)
    offsets = raw.joint_stamp_ns - np.sort(short.stamp_ns)
    assert np.ptp(offsets) <= 2e9 * can_logs.RESOLUTION_S[suffix]  # a format may begin at another zero
    between = raw.command_log_time_ns[0] - raw.joint_stamp_ns[0] - (short.command_ns[0] - short.stamp_ns[0])
    assert abs(between) <= 2e9 * can_logs.RESOLUTION_S[suffix]
    assert raw.message_counts == {"COMMAND": len(short.command), "ENCODERS": len(short.q)}
    assert not raw.notes


def test_times_are_absolute_to_the_microsecond(tmp_path, machine, short, recorded):
    for suffix in (".log", ".blf", ".csv", ".db"):
        raw = read(can_logs.write(tmp_path / f"a{suffix}", recorded), machine)
        resolution_ns = 1_000_000 if suffix == ".blf" else 1_000  # BLF's first time has milliseconds
        assert abs(raw.joint_stamp_ns[0] - short.stamp_ns[0]) <= resolution_ns
        (tmp_path / f"a{suffix}").unlink()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("notes.log", b"INFO (12.5) started\n"),
        ("grid.asc", b"ncols 4\nnrows 6\n"),
        ("x.trc", b"\0\0"),
        ("x.db", b"SQLite format 3\0"),
    ],
)
def test_other_files_of_these_suffixes_are_no_logs(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    assert not is_can_log(tmp_path / name)
    with pytest.raises(InputError, match="holds no logs"):
        find_logs(tmp_path)


def test_mf4_is_named(tmp_path, machine):
    (tmp_path / "a.mf4").write_bytes(b"MDF     4.10")
    with pytest.raises(InputError, match=r"a\.mf4: \.mf4 is not read; convert it"):
        read(tmp_path, machine)


def split_frames(short, machine, delays_ns):
    """One frame per joint: the encoders of joint i come `delays_ns[i]` after those of the first."""
    lines = ['VERSION "1"', "NS_ :", "BS_:", "BU_: A"]
    for i, joint in enumerate(machine.joint_names):
        lines += [f"BO_ {256 + i} POS_{joint}: 8 A", ' SG_ angle : 0|32@1- (1e-8,0) [-10|10] "rad" A']
        lines += [f"BO_ {2147483648 + 512 + i} CMD_{joint}: 2 A", ' SG_ valve : 7|16@0- (0.5,0) [-2|2] "" A']
    database = cantools.database.load_string("\n".join(lines) + "\n")
    frames = []
    for i, joint in enumerate(machine.joint_names):
        position, command = (database.get_message_by_name(f"{kind}_{joint}") for kind in ("POS", "CMD"))
        q = np.interp(short.stamp_ns + delays_ns[i], short.stamp_ns, short.q[:, i])
        for t, x in zip(short.stamp_ns + delays_ns[i], q, strict=True):
            frames.append((t, position, {"angle": float(x)}))
        for t, a in zip(short.command_ns + delays_ns[i], short.command[:, i], strict=True):
            frames.append((t, command, {"valve": float(a)}))
    messages = [
        can.Message(
            timestamp=int(t) / 1e9,
            arbitration_id=frame.frame_id,
            is_extended_id=frame.is_extended_frame,
            data=frame.encode(values),
        )
        for t, frame, values in sorted(frames, key=lambda one: one[0])
    ]
    return "\n".join(lines) + "\n", messages


def test_one_frame_per_joint(tmp_path, machine, short, config, loop_tracker):
    """Positions of all joints are brought to the times of the first; extended identifiers, big-endian signals."""
    text, messages = split_frames(short, machine, DELAYS_NS)
    (tmp_path / "arm.dbc").write_text(text)
    source = CanSource(str(tmp_path / "arm.dbc"), "", ["POS_{joint}.angle"], ["CMD_{joint}.valve"])
    described = replace(machine, can=source)
    (tmp_path / "logs").mkdir()
    raw = read(can_logs.write(tmp_path / "logs" / "a.log", messages), described)
    inside = ~np.isnan(raw.q).any(axis=1)
    assert inside.sum() >= len(short.q) - 2
    at = raw.joint_stamp_ns[inside]
    for i, delay in enumerate(DELAYS_NS):  # as NumPy interpolates between what was recorded of each joint
        recorded_q = np.interp(short.stamp_ns + delay, short.stamp_ns, short.q[:, i])
        expected = np.interp(at, short.stamp_ns + delay, recorded_q)
        assert np.abs(raw.q[inside, i] - expected).max() < 1e-6  # times have microseconds
    assert len(raw.command) > len(short.command) and not raw.notes
    summary = ingest(described, tmp_path / "logs", tmp_path / "tuples", config, loop_tracker)
    assert not summary.failures and summary.reports[0].metrics["n_rows"] > 80
    (tmp_path / "arm.dbc").write_text(text.replace("(1e-8,0)", "(2e-8,0)"))
    again = ingest(described, tmp_path / "logs", tmp_path / "tuples", config, loop_tracker)
    assert again.n_skipped == 0  # another DBC file gives other positions


def test_merging_by_parts_is_merging_at_once():
    rng = np.random.default_rng(0)
    times = [np.sort(rng.integers(0, 10**10, n)) for n in (500, 300)]
    values = [rng.normal(size=(len(t), 1)) for t in times]
    for is_held in (False, True):
        whole = MergedFrames([[1], [0]], 2, is_held)
        parts = MergedFrames([[1], [0]], 2, is_held)
        found = []
        for number in range(2):
            whole.add(number, times[number], values[number])
        for begin in range(0, 10**10, 10**9):
            for number in range(2):
                chosen = (times[number] >= begin) & (times[number] < begin + 10**9)
                parts.add(number, times[number][chosen], values[number][chosen])
            found.append(parts.rows(begin == 9 * 10**9))
        at, rows = whole.rows(True)
        np.testing.assert_array_equal(np.concatenate([part[0] for part in found]), at)
        np.testing.assert_allclose(np.concatenate([part[1] for part in found]), rows, rtol=0, atol=1e-12)
        assert parts.n_late == 0


def test_a_frame_that_stays_away_does_not_hold_the_others_up():
    merged = MergedFrames([[0], [1]], 2, False)
    merged.add(0, np.arange(0, 10**10, 10**8), np.zeros((100, 1)))
    merged.add(1, np.arange(0, 10**9, 10**8), np.zeros((10, 1)))
    at, values = merged.rows()
    assert len(at) == 90 and np.isnan(values[11:, 1]).all() and len(merged.times[0]) < 20


def test_channels_are_signals_of_any_frame(tmp_path, machine, short, recorded):
    can_logs.write(tmp_path / "a.log", recorded)
    channels = [ChannelSource("counter", "COMMAND", "counter"), ChannelSource("oil", "/oil", "data")]
    raw = read(tmp_path / "a.log", replace(machine, channels=channels))
    np.testing.assert_array_equal(raw.channels["counter"].value, np.arange(len(short.command)) % 256)
    assert list(raw.channels) == ["counter"]


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (CanSource("absent.dbc"), r"absent\.dbc: no such file; name the DBC file in can\.database"),
        (CanSource("bobcat_e10.urdf"), r"bobcat_e10\.urdf: not a DBC file"),
        (
            CanSource(positions=["X.y_{joint}"]),
            r"can\.positions: no frame `X` in the DBC file; it has EMERGENCY",
        ),
        (CanSource(commands=["COMMAND.y_{joint}"]), r"has no signal `y_swing`; it has command_swing"),
        (CanSource(commands=["COMMAND.counter"]), r"can\.commands has 1 entries; list one per joint \(4\)"),
        (CanSource(bus="can7"), r"no usable frame ENCODERS; .* frames seen: none"),
    ],
)
def test_what_the_configuration_lacks(tmp_path, machine, recorded, source, message):
    can_logs.write(tmp_path / "a.log", recorded)
    with pytest.raises(InputError, match=message):
        read(tmp_path, replace(machine, can=source))


@pytest.mark.parametrize("suffix", [".log", ".asc", ".trc", ".csv"])
def test_damaged_lines_cost_their_frames(tmp_path, machine, short, recorded, suffix):
    path = can_logs.write(tmp_path / f"a{suffix}", recorded)
    lines = path.read_bytes().splitlines(keepends=True)
    for number in (100, 150, 200):
        lines[number] = lines[number][:12] + b"\0\0" + lines[number][14:]
    lines[250] = b"\xff" * 10_000 + b"\n"
    path.write_bytes(b"".join(lines))
    raw = read(path, machine)
    assert len(raw.q) + len(raw.command) == len(short.q) + len(short.command) - 4
    (note,) = raw.notes
    assert note.kind is NoteKind.damage and re.search(
        r"byte \d+: line 101 is not text, and \d more", note.text
    )


def test_relative_times_of_asc_are_refused(tmp_path, machine, recorded):
    path = can_logs.write(tmp_path / "a.asc", recorded)
    path.write_bytes(path.read_bytes().replace(b"timestamps absolute", b"timestamps relative"))
    with pytest.raises(InputError, match="its times are relative to the line before"):
        read(path, machine)


def test_blf_over_many_containers_and_uncompressed(tmp_path, machine, short, recorded):
    for level in (0, 6):
        with can.BLFWriter(tmp_path / "a.blf", compression_level=level) as writer:
            writer.max_container_size = 1 << 10  # frames begin in one container and end in the next
            for message in recorded:
                writer(message)
        raw = read(tmp_path / "a.blf", machine)
        assert len(raw.q) == len(short.q) and len(raw.command) == len(short.command) and not raw.notes
