"""Every folder of `../shared/logs` gives what its README's column "right" asks for.

The logs were built to break the reading, one of each kind. Each test file beside this one builds the kinds by itself;
this one reads the originals, where they are here.
"""

from dataclasses import dataclass

import pytest

from pipeline.configuration.load import load_section
from pipeline.logs.ingest import ingest
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.messages.raw_log import NoteKind
from pipeline.machine.specification import (
    CommandKind,
    CommandSource,
    CommandSourceKind,
    JointSpecification,
    MachineSpecification,
)
from tests.logs.conftest import shared_folder

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
    # Folders, metadata and names
    "foreign_metadata": Right(rows=(WHOLE,) * 2),
    "foreign_metadata_ros1": Right(rows=(WHOLE,) * 3),
    "link_latest": Right(
        failures=1, says=("latest.mcap: not an MCAP file",)
    ),  # the copy holds the link's text
    "metadata_and_others": Right(rows=(WHOLE,) * 3),
    "name_collision": Right(rows=(160, WHOLE, WHOLE)),
    "yaml_bomb": Right(says=("metadata.yaml is damaged",)),
    "yaml_deep": Right(rows=(WHOLE,) * 2),
}


@pytest.mark.parametrize("folder", FOLDERS)
def test_shared_log(folder, tmp_path):
    right = FOLDERS[folder]
    config = load_section("ingest", IngestConfig)
    tracker = load_section("control.loop_tracker", LoopTrackerConfig)
    summary = ingest(MACHINE, shared_folder("logs", folder), tmp_path, config, tracker)
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
