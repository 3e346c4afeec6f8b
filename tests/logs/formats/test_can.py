"""CAN logs in every format that `python-can` reads: what was recorded, whatever the frames' layout, and damage."""

import gzip
import lzma
import re
from copy import copy
from dataclasses import replace

import can
import cantools
import numpy as np
import pytest
import zstandard

from pipeline.errors import InputError
from pipeline.logs.conditioning.samples import Samples
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.can.detect import is_can_log
from pipeline.logs.formats.can.frames import read_frames
from pipeline.logs.formats.can.merged import merged_rows
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.formats.discovery.log_entry import LogFormat
from pipeline.logs.ingest import ingest
from pipeline.logs.messages.message_blocks import ReadingLedger
from pipeline.logs.messages.raw_log import NoteKind
from pipeline.logs.trajectories import make_trajectories
from pipeline.machine.log_sources import CanSource, ChannelSource
from tests.logs.conftest import make_session
from tests.logs.samples import can_logs

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


@pytest.mark.parametrize("suffix", [".mf4", ".mdf", ".MF4"])
def test_mf4_is_named(tmp_path, machine, suffix):
    (tmp_path / f"a{suffix}").write_bytes(b"MDF     4.10")
    with pytest.raises(InputError, match=rf"a\{suffix}: \{suffix.lower()} is not read; convert it"):
        read(tmp_path, machine)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_compressed_logs_are_read_or_named(tmp_path, machine, short, recorded, suffix):
    plain = can_logs.write(tmp_path / f"a{suffix}", recorded)
    content = plain.read_bytes()
    plain.unlink()
    (tmp_path / f"b{suffix.upper()}.gz").write_bytes(gzip.compress(content))
    (tmp_path / f"c{suffix}.zst").write_bytes(zstandard.compress(content))
    (tmp_path / "syslog.log.xz").write_bytes(lzma.compress(b"Nov 28 04:57:19 kernel: started\n"))
    named, found = find_logs(tmp_path)
    assert "compressed as .gz, which is not read; decompress it" in named.error
    assert len(read_log(found, machine).q) == len(short.q)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_suffixes_of_any_case(tmp_path, machine, short, recorded, suffix):
    can_logs.write(tmp_path / f"a{suffix}", recorded).rename(tmp_path / f"A{suffix.upper()}")
    assert len(read(tmp_path, machine).q) == len(short.q)


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


def by_frame(times, values, cuts):
    """Two frames of one value each, in order of time, in sections that end at the cuts."""
    at, number = np.concatenate(times), np.repeat([0, 1], [len(one) for one in times])
    rows = np.full((len(at), 3), np.nan)
    rows[:, 0], rows[np.arange(len(at)), 1 + number] = number, np.concatenate(values)
    order = np.argsort(at, kind="stable")
    return [Samples(at[part], rows[part]) for part in np.split(order, cuts)]


def merged(sections, is_held, gap_ns, notes=None):
    rows = merged_rows(sections, [[0], [1]], is_held, gap_ns, "rows", [] if notes is None else notes)
    found = [(part.time_ns, part.value, np.full(len(part), part.era)) for part in rows]
    return [np.concatenate(column) for column in zip(*found, strict=True)]


def test_rows_are_those_of_numpy_whatever_the_sections():
    rng = np.random.default_rng(0)
    times = [np.sort(rng.integers(0, 10**10, n)) for n in (500, 300)]
    values = [rng.normal(size=len(t)) for t in times]
    for cuts in ([], np.sort(rng.integers(0, 800, 30))):
        notes = []
        sections = by_frame(times, values, cuts)
        at, rows, _ = merged(sections, False, 10**9, notes)
        np.testing.assert_array_equal(at, times[0])
        np.testing.assert_array_equal(rows[:, 0], values[0])
        expected = np.interp(at, times[1], values[1], left=np.nan, right=np.nan)
        np.testing.assert_allclose(rows[:, 1], expected, rtol=0, atol=1e-12)
        at, rows, _ = merged(sections, True, 10**9, notes)
        every = np.unique(np.concatenate(times))
        np.testing.assert_array_equal(at, every[every >= max(times[0][0], times[1][0])])
        for column in range(2):
            last = np.searchsorted(times[column], at, side="right") - 1
            np.testing.assert_array_equal(rows[:, column], values[column][last])
        assert not notes


def test_commands_at_one_time_give_one_row_whatever_the_sections():
    at_ns = np.array([10, 10, 20, 20, 30], np.int64)
    value = np.array([[0, 1, np.nan], [1, np.nan, 2], [0, 3, np.nan], [1, np.nan, 4], [0, 5, np.nan]])
    for n_rows in range(1, 6):
        parts = [Samples(at_ns[row : row + n_rows], value[row : row + n_rows]) for row in range(0, 5, n_rows)]
        at, rows, _ = merged(parts, True, 10**9)
        np.testing.assert_array_equal(at, [10, 20, 30])
        np.testing.assert_array_equal(rows, [[1, 2], [3, 4], [5, 4]])


def test_a_frame_that_stays_away_is_not_interpolated():
    times = [np.arange(0, 10**10, 10**8), np.arange(0, 10**9, 10**8)]
    (waiting, *later) = by_frame(times, [np.zeros(100), np.zeros(10)], np.arange(10, 110, 10))
    at, values, _ = merged([waiting, *later], False, 10**9)
    np.testing.assert_array_equal(at, times[0])
    assert np.isnan(values[11:, 1]).all() and not np.isnan(values[:10]).any()


@pytest.mark.parametrize("is_held", [False, True])
def test_a_clock_set_back_begins_an_era_and_a_stray_time_costs_its_frame(is_held):
    times = [np.arange(10) * 10**8, np.arange(10) * 10**8 + 10**7]
    first, second = ([np.full(10, value), np.full(10, value)] for value in (1.0, 2.0))
    (before,), (after,) = by_frame(times, first, []), by_frame(times, second, [])
    before.time_ns[11] += 3600 * 10**9
    notes = []
    at, values, era = merged([before, after], is_held, 5 * 10**8, notes)
    assert set(era) == {0, 1} and np.isfinite(values).all(axis=1).sum() >= 16
    for value, number in ((1.0, 0), (2.0, 1)):
        own = values[era == number]
        np.testing.assert_array_equal(own[np.isfinite(own)], value)
    assert at.max() < 10**9
    (note,) = notes
    assert note.count == 1 and "far from both neighbours" in note.text


def test_commands_in_several_frames_and_a_clock_set_back(tmp_path, machine, short, config, loop_tracker):
    """Of the rows, those of sound halves: neither era's commands are put into the other."""
    text, messages = split_frames(short, machine, DELAYS_NS)
    (tmp_path / "arm.dbc").write_text(text)
    source = CanSource(str(tmp_path / "arm.dbc"), "", ["POS_{joint}.angle"], ["CMD_{joint}.valve"])
    described = replace(machine, can=source)

    def rows(name, chosen):
        entry = find_logs(can_logs.write(tmp_path / f"{name}.log", chosen))[0]
        raw = read_log(entry, described, None, config.maximum_gap_s)
        return make_trajectories(raw, described, config, loop_tracker)

    half = len(messages) // 2
    expected = [rows("first", messages[:half]), rows("second", messages[half:])]
    for message in messages[half:]:
        message.timestamp -= 2.0
    result = rows("both", messages)
    assert "the clock steps back; the log is split there" in "\n".join(note.text for note in result.notes)
    for one, other in zip(result.trajectories, expected, strict=True):
        np.testing.assert_array_equal(one.a, other.trajectories[0].a)
        np.testing.assert_allclose(one.q, other.trajectories[0].q, atol=1e-6)


def test_frames_on_two_buses_are_told(tmp_path, machine, short, recorded):
    again = [copy(message) for message in recorded]
    for message in again:
        message.channel, message.timestamp = 1, message.timestamp + 1e-3
    both = sorted([*recorded, *again], key=lambda message: message.timestamp)
    raw = read(can_logs.write(tmp_path / "a.log", both), machine)
    told = [note.text for note in raw.notes if note.kind is NoteKind.warning]
    assert len(told) == 2 and all(
        "on the buses can0, can1, and all are used; set can.bus" in text for text in told
    )
    raw = read(tmp_path / "a.log", replace(machine, can=replace(machine.can, bus="can1")))
    assert len(raw.q) == len(short.q) and not raw.notes


MULTIPLEXED = """VERSION "1"
NS_ :
BS_:
BU_: A
BO_ 256 ARM: 8 A
 SG_ page M : 0|8@1+ (1,0) [0|3] "" A
 SG_ p0 m0 : 8|32@1- (1e-6,0) [-10|10] "rad" A
 SG_ p1 m0 : 40|24@1- (1e-6,0) [-10|10] "rad" A
 SG_ p2 m1 : 8|32@1- (1e-6,0) [-10|10] "rad" A
 SG_ p3 m1 : 40|24@1- (1e-6,0) [-10|10] "rad" A
 SG_ raw m1 : 8|8@1+ (1,0) [0|255] "" A
BO_ 257 ARM: 1 A
 SG_ other : 0|8@1+ (1,0) [0|255] "" A
BO_ 258 CMD: 4 A
"""


def test_multiplexed_overlapping_and_repeated_frames(tmp_path, machine, short, capfd, caplog):
    """One frame with two joints on each of two pages; signals overlap, and another frame has the same name."""
    commands = "".join(f' SG_ c{i} : {8 * i}|8@1- (1,0) [-1|1] "" A\n' for i in range(4))
    text = (
        MULTIPLEXED.replace("BO_ 257 ARM", "BO_ 257 AUX")
        + commands
        + 'BO_ 259 AUX: 1 A\n SG_ b : 0|8@1+ (1,0) [0|1] "" A\n'
    )
    (tmp_path / "arm.dbc").write_text(text)
    frames = []
    for t, q in zip(short.stamp_ns, short.q, strict=True):
        for page in (0, 1):
            counts = np.rint(q[2 * page : 2 * page + 2] / 1e-6).astype(int)
            data = bytes([page]) + int(counts[0]).to_bytes(4, "little", signed=True)
            data += int(counts[1]).to_bytes(3, "little", signed=True)
            frames.append((int(t) + page * 2_000_000, 256, data))
    for t, a in zip(short.command_ns, short.command, strict=True):
        frames.append((int(t), 258, a.astype(np.int8).tobytes()))
    messages = [
        can.Message(timestamp=t / 1e9, arbitration_id=key, is_extended_id=False, data=data)
        for t, key, data in sorted(frames)
    ]
    positions, commands = ([f"{frame}{i}" for i in range(4)] for frame in ("ARM.p", "CMD.c"))
    source = CanSource(str(tmp_path / "arm.dbc"), "", positions, commands)
    raw = read(can_logs.write(tmp_path / "a.log", messages), replace(machine, can=source))
    assert not raw.notes and not caplog.records and capfd.readouterr().err == ""
    inside = ~np.isnan(raw.q).any(axis=1)
    assert inside.sum() == len(short.q) - 1
    np.testing.assert_allclose(raw.q[inside, :2], short.q[1:, :2], atol=1e-6)
    at, known = raw.joint_stamp_ns[inside], short.stamp_ns + 2_000_000
    for joint in (2, 3):
        assert np.abs(raw.q[inside, joint] - np.interp(at, known, short.q[:, joint])).max() < 2e-6
    np.testing.assert_array_equal(raw.command, short.command)


@pytest.mark.parametrize(
    ("topic", "field", "text"),
    [
        ("COMAND", "counter", "channel counter: no frame `COMAND` in the DBC file; it has EMERGENCY"),
        ("COMMAND", "countr", "channel counter: frame COMMAND has no signal `countr`; it has command_swing"),
    ],
)
def test_misspelt_channels_are_told(tmp_path, machine, recorded, topic, field, text):
    can_logs.write(tmp_path / "a.log", recorded)
    raw = read(tmp_path / "a.log", replace(machine, channels=[ChannelSource("counter", topic, field)]))
    (note,) = raw.notes
    assert note.kind is NoteKind.left_out and note.text.startswith(text) and not raw.channels


def test_frames_that_do_not_fit_are_told_of_channels_too(tmp_path, machine, recorded):
    identifier = can_logs.DATABASE.get_message_by_name("COMMAND").frame_id
    short_frames = [copy(message) for message in recorded]
    own = [message for message in short_frames if message.arbitration_id == identifier][:3]
    for message in own:
        message.data, message.dlc = message.data[:1], 1
    can_logs.write(tmp_path / "a.log", short_frames)
    raw = read(
        tmp_path / "a.log", replace(machine, channels=[ChannelSource("counter", "COMMAND", "counter")])
    )
    assert sorted(note.text for note in raw.notes) == [
        f"3 frames COMMAND ({role}) do not fit the DBC file; left out"
        for role in ("channel counter", "commands")
    ]


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
        (
            CanSource(bus="can7"),
            r"no usable frame ENCODERS; .* frames on bus can0, which can.bus leaves out",
        ),
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


@pytest.mark.parametrize("suffix", [".log", ".asc", ".trc", ".csv"])
def test_a_log_that_ends_within_a_frame_gives_no_wrong_bytes(tmp_path, machine, recorded, suffix):
    """Half a byte would be read as a byte."""
    path = can_logs.write(tmp_path / f"a{suffix}", recorded[:20])
    lines = [line for line in path.read_bytes().splitlines(keepends=True) if not line.startswith(b"End")]
    for n_lost in range(1, 12):
        path.write_bytes(b"".join(lines)[:-n_lost])
        ledger = ReadingLedger(path)
        frames = list(read_frames(path, ledger))
        assert [frame.data for frame in frames] == [frame.data for frame in recorded[:19]]
        (note,) = ledger.notes
        assert f"line {len(lines)} is not read" in note.text


def test_a_trc_log_without_its_columns_is_refused(tmp_path, machine, recorded):
    """`python-can` asks for the head again after each line, and at the file's end too."""
    path = can_logs.write(tmp_path / "a.trc", recorded)
    path.write_bytes(path.read_bytes().replace(b"$COLUMNS", b"$"))
    with pytest.raises(InputError, match=r"no usable frame .* is not read \(File has no column information"):
        read(path, machine)


def test_a_frame_of_asc_without_its_direction_is_told(tmp_path, machine, short, recorded):
    path = can_logs.write(tmp_path / "a.asc", recorded)
    lines = path.read_text().splitlines(keepends=True)
    lines[30] = re.sub(r"Rx +d \d ", "", lines[30])
    path.write_text("".join(lines))
    raw = read(path, machine)
    assert len(raw.q) + len(raw.command) == len(short.q) + len(short.command) - 1
    (note,) = raw.notes
    assert "line 31 is not read" in note.text


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


@pytest.mark.parametrize("level", [0, 6])
def test_a_wrong_length_in_a_blf_costs_its_container_or_frame_only(tmp_path, level):
    """Bits of lengths, types and versions of containers and frames; python-can's reader is the reference."""
    path, damaged = tmp_path / "a.blf", tmp_path / "b.blf"
    with can.BLFWriter(path, compression_level=level) as writer:
        writer.max_container_size = 1 << 10
        for number in range(120):
            writer(can.Message(timestamp=1.0 + number / 100, arbitration_id=5, data=bytes([number])))
    content = path.read_bytes()
    whole = [bytes(frame.data) for frame in can.BLFReader(path)]
    places = [match.start() for match in re.finditer(b"LOBJ", content)]
    most = len(whole) // len([place for place in places if content[place + 12] == 10]) + 2
    for place in places:
        for byte, bit in [(6, 3), (8, 6), (9, 4), (10, 1), (11, 7)]:  # length of the header; of the object
            spoilt = bytearray(content)
            spoilt[place + byte] ^= 1 << bit
            damaged.write_bytes(spoilt)
            ledger = ReadingLedger(damaged)
            found = [bytes(frame.data) for frame in read_frames(damaged, ledger)]
            lost = len(whole) - len(found)
            assert set(found) <= set(whole) and lost <= most, (place, byte)
            assert lost == 0 or any(note.kind is NoteKind.damage for note in ledger.notes)
