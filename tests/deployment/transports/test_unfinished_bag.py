"""What a killed recorder leaves behind is the log that it would have written."""

import contextlib
import dataclasses
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader
from mcap_ros2.decoder import DecoderFactory

from pipeline.deployment.components.recording import Recorder
from pipeline.deployment.graph_logs.graph_topics import read_graph_topics
from pipeline.deployment.messages import (
    EmergencyStop,
    JointCommand,
    JointState,
    MachineCommand,
    Message,
    SupervisorState,
    TargetPose,
    Topic,
)
from pipeline.deployment.transports.unfinished_bag import UnfinishedBag, unfinished
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.messages.columns import as_array
from pipeline.logs.messages.raw_log import RawLog
from pipeline.machine.specification import CommandKind, MachineSpecification
from tests.deployment.machines import MIDDLE, bobcat

BEGIN_NS, STEP_NS, N = 1_775_000_000_000_000_000, 20_000_000, 40
COLUMNS = ("joint_stamp_ns", "joint_log_time_ns", "q", "command_log_time_ns", "command")
KILLED = """
import os, signal, sys
from pathlib import Path
from pipeline.deployment.transports.unfinished_bag import UnfinishedBag
from tests.deployment.machines import bobcat
from tests.deployment.transports.test_unfinished_bag import said
recorder = UnfinishedBag(Path(sys.argv[1]), bobcat())
for topic, message, time_ns in said():
    recorder(topic, message, time_ns)
os.kill(os.getpid(), signal.SIGKILL)
"""


def said() -> list[tuple[Topic, Message, int]]:
    """States and commands, a target, a request, a stop, and what no bag holds."""
    target = TargetPose(BEGIN_NS, np.array([2.0, 0.1, 0.5]), np.array([0.6, 0.0, 0.8, 0.0]))
    messages: list[tuple[Topic, Message, int]] = [(Topic.target_pose, target, BEGIN_NS)]
    for n in range(N):
        stamp_ns = BEGIN_NS + n * STEP_NS
        values = np.array([1, 0, -1, n % 2], np.float32)
        request = JointCommand(stamp_ns, "server", n, stamp_ns, values)
        messages += [
            (
                Topic.joint_states,
                JointState(stamp_ns, MIDDLE + 0.01 * n, 0.5 - MIDDLE / (n + 1)),
                stamp_ns + 1,
            ),
            (Topic.requested_commands, request, stamp_ns + 2),
            (Topic.joint_commands, MachineCommand(stamp_ns, values), stamp_ns + 3),
            (Topic.supervisor_state, SupervisorState(stamp_ns, ""), stamp_ns + 4),
        ]
    end_ns = BEGIN_NS + N * STEP_NS
    return [*messages, (Topic.emergency_stop, EmergencyStop(end_ns, "joint_limits", "far"), end_ns)]


def scaled() -> MachineSpecification:
    """A machine whose logs hold other units, with continuous commands."""
    machine = bobcat()
    return dataclasses.replace(
        machine,
        command_kind=CommandKind.continuous,
        joint_states=dataclasses.replace(machine.joint_states, scale=[0.5], offset=[0.1]),
        commands=dataclasses.replace(machine.commands, scale=[2.0]),
    )


def only_log(folder: Path, machine: MachineSpecification) -> RawLog:
    (entry,) = find_logs(folder)
    return read_log(entry, machine)


@pytest.mark.parametrize("machine", [bobcat(), scaled()], ids=["as recorded", "scaled"])
def test_what_is_heard_reads_as_the_bag_that_follows(machine: MachineSpecification, tmp_path: Path) -> None:
    path, recorder = unfinished(tmp_path / "so_far/drive"), Recorder()
    so_far = UnfinishedBag(path, machine)
    assert not path.parent.exists()
    for entry in said():
        so_far(*entry)
        recorder(*entry)
    recorder.write(tmp_path / "bag/drive", machine)
    left, whole = only_log(path.parent, machine), only_log(tmp_path / "bag", machine)
    for column in COLUMNS:
        np.testing.assert_allclose(as_array(getattr(left, column)), as_array(getattr(whole, column)))
    assert left.targets is not None and whole.targets is not None
    np.testing.assert_array_equal(as_array(left.targets.position), as_array(whole.targets.position))
    np.testing.assert_array_equal(as_array(left.targets.quaternion), as_array(whole.targets.quaternion))
    records = [read_graph_topics(*find_logs(folder)) for folder in (path.parent, tmp_path / "bag")]
    assert [len(record.requests) for record in records] == [N, N]
    assert records[0].stops == records[1].stops


@pytest.mark.parametrize(
    ("machine", "scale"), [(bobcat(), 1.0), (scaled(), 0.5)], ids=["as recorded", "scaled"]
)
def test_another_reader_finds_the_velocities(
    machine: MachineSpecification, scale: float, tmp_path: Path
) -> None:
    so_far, recorder = UnfinishedBag(unfinished(tmp_path / "drive"), machine), Recorder()
    for entry in said():
        so_far(*entry)
        recorder(*entry)
    recorder.write(tmp_path / "drive", machine)
    expected = [state.velocity / scale for _, state, _ in said() if isinstance(state, JointState)]
    for path in (unfinished(tmp_path / "drive"), tmp_path / "drive/drive_0.mcap"):
        found = []
        with path.open("rb") as stream, contextlib.suppress(EndOfFile):  # of the one that is not finished
            reader = NonSeekingReader(stream, decoder_factories=[DecoderFactory()])
            for *_, content in reader.iter_decoded_messages(["/joint_states"], log_time_order=False):
                found.append(content.velocity)
        np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_a_killed_recorder_leaves_all_that_it_heard(tmp_path: Path) -> None:
    path = unfinished(tmp_path / "drive")
    killed = subprocess.run([sys.executable, "-c", KILLED, str(path)], cwd=Path(__file__).parents[3])
    assert killed.returncode == -signal.SIGKILL
    assert len(as_array(only_log(tmp_path, bobcat()).q)) == N


@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
def test_a_file_that_ends_anywhere_is_read_up_to_there(share: float, tmp_path: Path) -> None:
    path = unfinished(tmp_path / "drive")
    so_far = UnfinishedBag(path, bobcat())
    for entry in said():
        so_far(*entry)
    size = path.stat().st_size
    os.truncate(path, round(share * size))
    n_read = len(as_array(only_log(tmp_path, bobcat()).q))
    assert 0.5 * share * N < n_read < N
