"""Bags of ROS 1's own recorder on a running graph, against what ROS's own Python library reads from them."""

import pickle
import shutil
import signal
import subprocess
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.messages.raw_log import NANOSECONDS, NoteKind
from tests.ros_graph import DEBIAN_PYTHON, ROSBAG, ROSBAG_RECORD, RosGraph, requires_debian

pytestmark = [pytest.mark.long, requires_debian()]

HERE = Path(__file__).parents[1] / "samples"
TOPICS = ("/joint_states", "/joint_commands", "/target_pose", "/joy")
SHARED_TOPICS = ("/shared/joint_states", "/shared/joint_commands")  # two nodes publish them
CHUNK, LARGE_CHUNK = "--chunksize=8", "--chunksize=65536"  # kB; the recorder's own default is 768

RECORDED = {
    "none": (*TOPICS, *SHARED_TOPICS),
    "bz2": ("--bz2", *TOPICS, *SHARED_TOPICS),
    "lz4": ("--lz4", "--all", "--exclude=/bulk"),
    "none_chunks": (CHUNK, *TOPICS, *SHARED_TOPICS),
    "bz2_chunks": ("--bz2", CHUNK, *TOPICS, *SHARED_TOPICS),
    "lz4_chunks": ("--lz4", CHUNK, *TOPICS, *SHARED_TOPICS),
}
SPLIT = ("--lz4", "--split", "--duration=1", "--repeat-latched", *TOPICS, *SHARED_TOPICS)
KILLED = {
    "killed_none": TOPICS,
    "killed_bz2": ("--bz2", *TOPICS),
    "killed_lz4": ("--lz4", *TOPICS),
    "killed_none_chunks": (CHUNK, *TOPICS),
    "killed_bz2_chunks": ("--bz2", CHUNK, *TOPICS),
    "killed_lz4_chunks": ("--lz4", CHUNK, *TOPICS),
    "killed_bz2_bulk": ("--bz2", LARGE_CHUNK, "/bulk", *TOPICS),
    "killed_lz4_bulk": ("--lz4", LARGE_CHUNK, "/bulk", *TOPICS),
}
CUT = ("cut_none_chunks", "cut_bz2_chunks", "cut_lz4_chunks")  # the recorder's bag without its end
CUT_AT = 0.6  # of the file
CRASHED = (*KILLED, *CUT)
EMPTY = ("killed_bz2", "killed_lz4")
CONVERTED = ("compressed_bz2", "compressed_lz4", "decompressed", "filtered")
# What recorders write between the time that all topics are sent and their end, by the ends of their names.
WRITTEN_BYTES = {"none": 20_000, "chunks": 15_000, "bulk": 1_200_000, "bz2": 0, "lz4": 0}
COMPLETE_PARTS = 2  # split bags from start to end within the time that all topics are sent
MINIMUM_SAMPLES = 50  # so that no comparison is one of nothing; nominally 50 Hz for four seconds
TOOL_TIMEOUT_S = 60


@dataclass(frozen=True)
class Recorded:
    """A folder of bags and, by file name, what `rosbag.Bag` reads from each."""

    folder: Path
    reference: dict[str, dict]

    def messages(self, name: str, topic: str) -> list[tuple]:
        return self.reference[name]["topics"].get(topic, {"messages": []})["messages"]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Recorded:
    folder = tmp_path_factory.mktemp("live")
    record(folder)
    convert(folder)
    return Recorded(folder, read_with_rosbag(sorted(folder.glob("*.bag")), folder / "reference.pickle"))


def record(folder: Path) -> None:
    """Run two nodes and all recorders side by side; kill some recorders, end the others as Ctrl-C does."""
    with RosGraph(folder / "graph") as graph:
        for kind in ("arm", "second"):
            graph.start(kind, [DEBIAN_PYTHON, HERE / "ros_publishers.py", kind])
        graph.wait_for_publishers("/target_pose")
        graph.wait_for_publishers(SHARED_TOPICS[-1], 2)
        recorders = {}
        for name, options in {**RECORDED, **KILLED, "split": SPLIT}.items():
            recorders[name] = graph.start(name, [ROSBAG_RECORD, *options, "-O", folder / name])
            for topic in TOPICS:  # one recorder after the other: rospy lets only five connections wait
                graph.wait_for_connections("/arm", topic, len(recorders))
        for topic in SHARED_TOPICS:
            graph.wait_for_connections("/second", topic, len(recorders) - len(KILLED))
        closed = _closed_parts(folder)
        enough = _written_bytes(folder) + [WRITTEN_BYTES[name.split("_")[-1]] for name in KILLED]
        graph.wait_until(lambda: bool((_written_bytes(folder) >= enough).all()), "bytes of all recorders")
        killed = graph.stop(*(recorders[name] for name in KILLED), number=signal.SIGKILL)
        assert set(killed) == {-signal.SIGKILL}
        graph.wait_until(lambda: _closed_parts(folder) > closed + COMPLETE_PARTS, "split bags")
        assert set(graph.stop(*(recorders[name] for name in (*RECORDED, "split")))) == {0}


def _closed_parts(folder: Path) -> int:
    return len(list(folder.glob("split_*.bag")))


def _written_bytes(folder: Path) -> np.ndarray:
    return np.array([(folder / f"{name}.bag.active").stat().st_size for name in KILLED])


def convert(folder: Path) -> None:
    """Have ROS's command line write bags from the recorder's."""
    for source, name in (("none", "compressed_bz2"), ("bz2", "compressed_lz4"), ("lz4", "decompressed")):
        shutil.copy(folder / f"{source}.bag", folder / f"{name}.bag")
    rosbag("compress", "-q", "--bz2", folder / "compressed_bz2.bag")
    rosbag("compress", "-q", "--lz4", folder / "compressed_lz4.bag")
    rosbag("decompress", "-q", folder / "decompressed.bag")
    chosen = "topic == '/target_pose' or topic != '/joy' and t.nsecs < 600000000"
    rosbag("filter", folder / "lz4_chunks.bag", folder / "filtered.bag", chosen)
    for name in CUT:
        whole = (folder / f"{name.removeprefix('cut_')}.bag").read_bytes()
        (folder / f"{name}.bag.active").write_bytes(whole[: int(CUT_AT * len(whole))])
    for name in CRASHED:
        shutil.copy(folder / f"{name}.bag.active", folder / f"reindexed_{name}.bag")
    rosbag("reindex", "-q", *sorted(folder.glob("reindexed_*.bag")))
    for backup in folder.glob("*.orig.bag"):
        backup.unlink()


def rosbag(*arguments: str | Path) -> None:
    run(ROSBAG, *arguments)


def run(*command: str | Path) -> None:
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=TOOL_TIMEOUT_S)
    assert done.returncode == 0, done.stdout.decode(errors="replace")


def read_with_rosbag(paths: list[Path], result: Path) -> dict[str, dict]:
    run(DEBIAN_PYTHON, HERE / "ros_reference.py", result, *paths)
    return {Path(path).name: contents for path, contents in pickle.loads(result.read_bytes()).items()}


def read_only(path: Path, machine):
    (entry,) = find_logs(path)
    return read_log(entry, machine)


def bits(values) -> bytes:
    """So that NaN equals NaN and -0.0 differs from 0.0."""
    return np.asarray(values, dtype=np.float64).tobytes()


def rows(*columns) -> list[tuple]:
    """Messages in the order of their log times, which is that of `read_messages`."""
    plain = [np.asarray(column[:]) for column in columns]
    order = np.argsort(plain[0], kind="stable")
    return [tuple(bits(column[i]) if column.ndim > 1 else int(column[i]) for column in plain) for i in order]


def joint_rows(raw) -> list[tuple]:
    return rows(raw.joint_log_time_ns, raw.joint_stamp_ns, raw.q)


def command_rows(raw) -> list[tuple]:
    return rows(raw.command_log_time_ns, raw.command)


def expected_joint_rows(messages, machine) -> list[tuple]:
    return [
        (time_ns, seconds * NANOSECONDS + rest, bits([position[names.index(j)] for j in machine.joint_names]))
        for time_ns, (seconds, rest, _, names, position) in messages
    ]


def expected_command_rows(messages) -> list[tuple]:
    return [(time_ns, bits(data)) for time_ns, data in messages]


def assert_same(raw, recorded: Recorded, name: str, machine) -> None:
    """Every message of the log, bit for bit, and nothing else."""
    states = recorded.messages(name, machine.joint_states.topic)
    commands = recorded.messages(name, machine.commands.topic)
    targets = recorded.messages(name, machine.target_topic)
    assert joint_rows(raw) == expected_joint_rows(states, machine)
    assert command_rows(raw) == expected_command_rows(commands)
    if targets:
        poses = raw.targets
        assert rows(poses.log_time_ns, poses.position, poses.quaternion) == [
            (time_ns, bits(position), bits(turn)) for time_ns, (_, position, turn) in targets
        ]
        assert {poses.frame_id} == {frame for _, (frame, _, _) in targets} == {"base"}
    topics = recorded.reference[name]["topics"]
    assert raw.message_counts == {topic: len(found["messages"]) for topic, found in topics.items()}
    assert raw.notes == ()


def at(machine, joint_states="/joint_states", joint_commands="/joint_commands", **source):
    """The machine with other topics and, if need be, another command source."""
    commands = replace(machine.commands, topic=joint_commands, **source)
    return replace(machine, joint_states=replace(machine.joint_states, topic=joint_states), commands=commands)


@pytest.mark.parametrize("name", (*RECORDED, *CONVERTED))
def test_whole_bags(name, recorded, machine):
    raw = read_only(recorded.folder / f"{name}.bag", machine)
    assert_same(raw, recorded, f"{name}.bag", machine)
    assert len(raw.q) > MINIMUM_SAMPLES
    assert len(raw.targets.position) >= 2
    expected = {
        "compressed_bz2": "bz2",
        "compressed_lz4": "lz4",
        "decompressed": "none",
        "filtered": "none",
        "none_chunks": "none",
        "bz2_chunks": "bz2",
        "lz4_chunks": "lz4",
    }
    assert recorded.reference[f"{name}.bag"]["compression"] == expected.get(name, name)


def test_graph_was_as_intended(recorded, machine):
    """What the other tests take for granted, by ROS's own reading."""
    topics = recorded.reference["none.bag"]["topics"]
    assert topics["/target_pose"]["latching"] == {"1"}
    for topic in SHARED_TOPICS:
        assert topics[topic]["callers"] == {"/arm", "/second"}
    states = recorded.messages("none.bag", "/joint_states")
    assert {names for _, (*_, names, _) in states} == {("arm", "pump", "swing", "bucket", "boom")}
    assert len({names for _, (*_, names, _) in recorded.messages("none.bag", SHARED_TOPICS[0])}) == 2
    positions = np.array([position for _, (*_, position) in states])
    assert np.isnan(positions).any() and (np.signbit(positions) & (positions == 0)).any()
    assert set(recorded.reference["lz4.bag"]["topics"]) >= {*TOPICS, *SHARED_TOPICS, "/rosout"}
    whole, part = (recorded.messages(name, "/joint_states") for name in ("lz4_chunks.bag", "filtered.bag"))
    assert len(part) < len(whole)


def test_split_bags_hold_all_between_them(recorded, machine):
    """Each part as ROS reads it; between the parts no sample is lost; latched poses stand in each anew."""
    parts = sorted(recorded.folder.glob("split_*.bag"), key=lambda part: int(part.stem.split("_")[1]))
    assert set(parts) <= {entry.path for entry in find_logs(recorded.folder)}
    complete = 0
    for part in parts:
        states, commands = (recorded.messages(part.name, topic) for topic in TOPICS[:2])
        if states and commands:
            raw = read_only(part, machine)
            assert_same(raw, recorded, part.name, machine)
            complete += 1
        else:  # the first and the last part may be shorter than the slowest topic's period
            with pytest.raises(InputError, match="not in the log"):
                read_only(part, machine)
    assert complete >= COMPLETE_PARTS
    numbers = [n for part in parts for _, (_, _, n, *_) in recorded.messages(part.name, "/joint_states")]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    poses = [[pose for _, pose in recorded.messages(part.name, "/target_pose")] for part in parts]
    first, *others = [part for part in poses if part]
    assert len(others) >= COMPLETE_PARTS
    # ROS 1.15.15 repeats the first pose that it got. A pose still in its queue at the split stands before it.
    assert all(first[0] in part for part in others)


@pytest.mark.parametrize("name", ["none", "bz2_chunks", "lz4"])
def test_topics_of_two_publishers(name, recorded, machine):
    """Two connections of one topic, whose messages list different joints in different orders."""
    shared = at(machine, *SHARED_TOPICS)
    raw = read_only(recorded.folder / f"{name}.bag", shared)
    assert_same(raw, recorded, f"{name}.bag", shared)
    assert len(raw.q) > 1.5 * len(recorded.messages(f"{name}.bag", "/joint_states"))


@pytest.mark.parametrize("name", ["none_chunks", "bz2", "lz4"])
def test_joystick_commands(name, recorded, machine):
    """Beyond the threshold is full deflection, at it and below is rest."""
    axes, signs, threshold = (4, 0, 5, 2), (1.0, -1.0, 1.0, -1.0), 0.5
    joystick = at(machine, joint_commands="/joy", source="joy", axes=axes, signs=signs, threshold=threshold)
    raw = read_only(recorded.folder / f"{name}.bag", joystick)
    expected = []
    for time_ns, deflections in recorded.messages(f"{name}.bag", "/joy"):
        values = [sign * deflections[axis] for axis, sign in zip(axes, signs, strict=True)]
        sticks = [1.0 if v > threshold else -1.0 if v < -threshold else 0.0 for v in values]
        expected.append((time_ns, bits(sticks)))
    assert command_rows(raw) == expected
    found, counts = np.unique(raw.command[:], return_counts=True)
    assert found.tolist() == [-1, 0, 1] and counts.min() > 5


@pytest.mark.parametrize("name", [name for name in CRASHED if name not in EMPTY])
def test_crashed_recordings(name, recorded, machine):
    """`rosbag reindex` recovers no message that we do not, and what we recover was sent."""
    raw = read_only(recorded.folder / f"{name}.bag.active", machine)
    recovered, reindexed = joint_rows(raw), f"reindexed_{name}.bag"
    theirs = expected_joint_rows(recorded.messages(reindexed, "/joint_states"), machine)
    assert Counter(theirs) <= Counter(recovered)
    commands = expected_command_rows(recorded.messages(reindexed, "/joint_commands"))
    assert Counter(commands) <= Counter(command_rows(raw))
    for topic, found in recorded.reference[reindexed]["topics"].items():
        assert raw.message_counts[topic] >= len(found["messages"])

    sent = {
        stamp: q
        for _, stamp, q in expected_joint_rows(recorded.messages("none.bag", "/joint_states"), machine)
    }
    known = [(stamp, q) for _, stamp, q in recovered if stamp >= min(sent)]
    assert len(known) > 20
    assert all(sent[stamp] == q for stamp, q in known)
    stamps = [stamp for stamp, _ in known]
    assert stamps == sorted(sent)[sorted(sent).index(stamps[0]) :][: len(stamps)]  # without a hole
    assert raw.notes  # that its recorder was killed is told
    assert all(
        note.kind == NoteKind.damage and f"{name}.bag.active, byte " in note.text for note in raw.notes
    )


@pytest.mark.parametrize("name", EMPTY)
def test_killed_before_the_compressor_wrote_a_block(name, recorded, machine):
    """The whole recording was in the recorder's memory: neither reads anything, and the line says where."""
    assert recorded.reference[f"reindexed_{name}.bag"]["topics"] == {}
    with pytest.raises(InputError, match=rf"{name}\.bag\.active, byte \d+: the file ends within this chunk"):
        read_only(recorded.folder / f"{name}.bag.active", machine)


@pytest.mark.parametrize("name", [name for name in CRASHED if name.endswith("_chunks")])
def test_reindexed_bags(name, recorded, machine):
    """`rosbag reindex` writes an index over what the killed recorder left, and cuts off the rest."""
    raw = read_only(recorded.folder / f"reindexed_{name}.bag", machine)
    assert_same(raw, recorded, f"reindexed_{name}.bag", machine)
    assert len(raw.q) > 20
