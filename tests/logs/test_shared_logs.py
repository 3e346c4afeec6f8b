"""Every folder of `../shared/logs` gives what its README's column "right" asks for.

The logs were built to break the reading, one of each kind. Each test file beside this one builds the kinds by itself;
this one reads the originals, where they are here.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from pipeline.configuration.load import load_section
from pipeline.logs.ingest import IngestSummary, ingest
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.messages.raw_log import NoteKind
from pipeline.logs.tuples import read_tuples
from pipeline.machine.log_sources import CommandSource, CommandSourceKind, JointStateSource
from pipeline.machine.specification import CommandKind, JointSpecification, MachineSpecification
from tests.logs.conftest import shared_folder
from tests.logs.samples import foreign_bags as foreign

WHOLE = 240  # rows of a log where nothing is lost
MACHINE = MachineSpecification(
    "two",
    20.0,
    [JointSpecification(name, -3.0, 3.0) for name in ("j1", "j2")],
    CommandKind.continuous,
    commands=CommandSource("/joint_commands", CommandSourceKind.array),
)


@dataclass(frozen=True)
class Right:
    """What is right for a folder.

    Attributes:
        rows: Rows of each log, in the order of the logs' names; at least, where `at_least` says so.
        failures: How many logs are refused, each in one line.
        says: Texts that the notes and the failures' lines must hold.
        damage: Whether damage is told; None: either.
        at_least: Whether more rows are right too.
    """

    rows: tuple[int, ...] = (WHOLE,)
    failures: int = 0
    says: tuple[str, ...] = ()
    damage: bool | None = False
    at_least: bool = False


FOLDERS: dict[str, Right] = {
    # Messages and records of MCAP files and ROS 1 bags
    "bomb_channels": Right(damage=None, at_least=True),
    "bomb_headers": Right(damage=None, at_least=True),
    "bomb_messages": Right(damage=None, at_least=True),
    "db3_unordered": Right(says=("put in order",)),
    "empty_sequence": Right(rows=(), failures=1),
    "flip_footer": Right(says=("opcode 2 is damaged",), damage=True),
    "flip_index": Right(says=("opcode 7 is damaged",), damage=True),
    "future_opcode": Right(),
    "lz4_frames": Right(),
    "private_in_chunk": Right(),
    "private_no_index": Right(),
    "pub2_cmd_ros1": Right(),
    "pub2_mcap": Right(),
    "pub2_ros1": Right(),
    "ros1_byte": Right(),
    "ros1_connections": Right(),
    "rosbags_size1": Right(),
    "two_chunks_swapped": Right(says=("put in order",)),
    "unsorted_chunks": Right(says=("put in order",)),
    "xcdr2": Right(rows=(), failures=1, says=("XCDR2",)),
    "zstd_frames": Right(),
    # Clocks, values and tables
    "csv_dates": Right(rows=(), failures=1, says=("a.csv: ", "`2023-11-14 22:13:20", "not a number of s")),
    "csv_utf16": Right(rows=(), failures=1, says=("csv_utf16/a.csv: is text in UTF-16",)),
    "huge_values": Right(rows=(), failures=1, says=("position of j2 is beyond 1e+06 rad",)),
    "offset5": Right(
        rows=(141,), says=("/joint_states are 5.000 s before", "joint_states.clock", "clock_offset_s")
    ),
    "one_zero_stamp": Right(says=("joint samples: their header stamp is zero",)),
    "pq_datetime": Right(),
    "pq_duration": Right(),
    "pq_list": Right(rows=(), failures=1, says=("pq_list/a.parquet: column q_j1 holds List(Float64)",)),
    "simtime_zero": Right(says=("commands: their log time is zero",)),
    # SQLite
    "db3_neg": Right(says=("15 rows hold no message or an impossible time",), damage=True),
    "second_type_empty": Right(),
    "shm_only": Right(),
    "topic_rows_twice": Right(),
    # Folders, metadata and names
    "foreign_metadata": Right(rows=(WHOLE,) * 2),
    "foreign_metadata_ros1": Right(rows=(WHOLE,) * 3),
    "link_latest": Right(failures=1, says=("latest.mcap: not an MCAP file",)),  # it holds the link's text
    "metadata_and_others": Right(rows=(WHOLE,) * 3),
    "name_collision": Right(rows=(160, WHOLE, WHOLE)),
    "yaml_bomb": Right(says=("metadata.yaml is damaged",)),
    "yaml_deep": Right(rows=(WHOLE,) * 2),
}


def ingested(folder: str, machine: MachineSpecification, output: Path) -> IngestSummary:
    config = load_section("ingest", IngestConfig)
    tracker = load_section("control.loop_tracker", LoopTrackerConfig)
    return ingest(machine, shared_folder("logs", folder), output, config, tracker)


@pytest.mark.parametrize("folder", FOLDERS)
def test_shared_log(folder, tmp_path):
    right = FOLDERS[folder]
    summary = ingested(folder, MACHINE, tmp_path)
    reports = sorted(summary.reports, key=lambda report: report.name)
    notes = [note for report in reports for note in report.notes]
    told = "\n".join([*(note.text for note in notes), *(failure.reason for failure in summary.failures)])
    rows = [int(report.metrics["n_rows"] or 0) for report in reports]
    assert len(summary.failures) == right.failures and len(rows) == len(right.rows), told
    for found, expected in zip(rows, right.rows, strict=True):
        assert found == expected or (right.at_least and expected < found <= WHOLE), (rows, told)
    for text in right.says:
        assert text in told, told
    if right.damage is not None:
        assert right.damage == any(note.kind is NoteKind.damage for note in notes), told


def test_a_stated_offset_gives_the_right_rows(tmp_path):
    """Against the messages as the `mcap` library and `rosbags` read them, stamps 5 s later, by NumPy."""
    stated = replace(MACHINE, joint_states=JointStateSource(clock_offset_s=5.0))
    (report,) = ingested("offset5", stated, tmp_path).reports
    assert report.warnings == [] and report.line == "a: 240 rows, 12 s"
    (rows,) = read_tuples(tmp_path, stated)
    messages: dict[str, list] = {"/joint_states": [], "/joint_commands": []}
    with (shared_folder("logs", "offset5") / "a.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            content = foreign.ROS2.deserialize_cdr(message.data, schema.name)
            messages[channel.topic].append((message.log_time, content))
    states = [content for _, content in messages["/joint_states"]]
    stamp_ns = np.array(
        [10**9 * (state.header.stamp.sec + 5) + state.header.stamp.nanosec for state in states]
    )
    q = np.array([[state.position[state.name.index(joint)] for joint in ("j1", "j2")] for state in states])
    command_ns, commands = zip(*messages["/joint_commands"], strict=True)
    np.testing.assert_array_equal(rows.stamp_ns, stamp_ns[0] + 50_000_000 * np.arange(WHOLE))
    for joint in range(2):
        expected = np.interp(
            (rows.stamp_ns - stamp_ns[0]).astype(float), (stamp_ns - stamp_ns[0]).astype(float), q[:, joint]
        )
        np.testing.assert_allclose(rows.q[:, joint], expected, rtol=0, atol=1e-12)
    in_force = np.searchsorted(command_ns, rows.stamp_ns, side="right") - 1
    np.testing.assert_array_equal(rows.a, [commands[number].data for number in in_force])
