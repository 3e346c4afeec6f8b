"""What `describe` says of logs, and that the machine drafted from them reads them."""

import re
import shutil
import time
from dataclasses import replace

import can
import numpy as np
import polars
import pytest
import yaml
from omegaconf import OmegaConf

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.errors import InputError
from pipeline.logs.describe.describe import describe
from pipeline.logs.describe.draft import UNKNOWN, draft_machine
from pipeline.logs.describe.listing import listing
from pipeline.logs.describe.tables import time_unit
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.machine.log_sources import CommandSourceKind
from pipeline.machine.specification import MachineSpecification
from tests.logs.conftest import make_session
from tests.logs.samples import can_logs, self_describing_bags, whole_logs
from tests.logs.samples import foreign_bags as foreign
from tests.stages.command import run_stage


@pytest.fixture(scope="module")
def short(machine):
    return make_session(machine, seconds=6)


def filled_in(draft: str) -> MachineSpecification:
    """The draft after a user has set name and limits."""
    text = draft.replace(f"name: {UNKNOWN}", "name: mine", 1)
    text = re.sub(rf"lower: {re.escape(UNKNOWN)}, upper: {re.escape(UNKNOWN)}", "lower: -3, upper: 3", text)
    assert UNKNOWN not in "".join(line.partition("#")[0] for line in text.splitlines()), text
    return OmegaConf.to_object(
        OmegaConf.merge(OmegaConf.structured(MachineSpecification), OmegaConf.create(text))
    )


def read_with_draft(folder):
    contents = describe(folder)
    drafted = filled_in(draft_machine(contents, ""))
    (entry,) = find_logs(folder)
    return drafted, read_log(entry, drafted), "\n".join(listing(contents))


def test_bag_of_joint_states_and_an_array(tmp_path, machine, short):
    short.write(tmp_path / "a", machine)
    drafted, raw, text = read_with_draft(tmp_path)
    assert drafted.joint_names == machine.joint_names and drafted.command_kind == "discrete"
    np.testing.assert_array_equal(raw.q, short.q)
    np.testing.assert_array_equal(raw.command, short.command)
    low, high = short.q.min(axis=0), short.q.max(axis=0)
    assert f"{low[0]:.4g} to {high[0]:.4g}; {low[1]:.4g} to {high[1]:.4g}" in text
    assert "/joint_commands: std_msgs/msg/Int8MultiArray, 120 messages, 20 Hz" in text
    assert "swing, boom, arm, bucket" in text


def test_ranges_follow_names_that_change_their_order(tmp_path, machine, short):
    names = machine.joint_names
    entries = [
        (int(t), "/joint_states", foreign.joint_state(foreign.ROS2, t, *pair))
        for i, (t, q) in enumerate(zip(short.stamp_ns, short.q, strict=True))
        for pair in [(names, q) if i % 2 else (names[::-1], q[::-1])]
    ]
    foreign.write_mcap(tmp_path / "a.mcap", entries)
    (stream,) = describe(tmp_path).streams.values()
    assert list(stream.names) == list(names[::-1])
    np.testing.assert_array_equal(stream.fields["position"].low, short.q.min(axis=0)[::-1])


@pytest.mark.parametrize("kind", self_describing_bags.KINDS)
def test_json_and_protobuf(tmp_path, machine, short, kind):
    self_describing_bags.write(tmp_path / "a.mcap", kind, short, machine.joint_names)
    drafted, raw, _ = read_with_draft(tmp_path)
    assert drafted.commands.source == CommandSourceKind.array
    np.testing.assert_array_equal(raw.q, short.q)
    np.testing.assert_array_equal(raw.command, short.command)


def test_joystick_and_joint_state_commands(tmp_path, machine, short):
    states = foreign.messages(
        foreign.ROS2,
        replace(short, command_ns=short.command_ns[:0], command=short.command[:0]),
        machine.joint_names,
    )
    for topic, message, source in (
        ("/joy", lambda t, a: foreign.joy(foreign.ROS2, t, [*a, 0.5]), CommandSourceKind.joy),
        (
            "/arm_cmd",
            lambda t, a: foreign.joint_state(foreign.ROS2, t, machine.joint_names, [], velocity=a),
            CommandSourceKind.joint_state,
        ),
    ):
        commands = [
            (int(t), topic, message(t, a)) for t, a in zip(short.command_ns, short.command, strict=True)
        ]
        folder = tmp_path / topic[1:]
        foreign.write_mcap(folder / "a.mcap", sorted(states + commands, key=lambda entry: entry[0]))
        drafted, raw, _ = read_with_draft(folder)
        assert drafted.commands.topic == topic and drafted.commands.source == source
        assert len(raw.command) == len(short.command)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
@pytest.mark.parametrize(
    ("position", "command"), [("q_{}", "a_{}"), ("{}.angle", "{}.valve_cmd"), ("pos/{}", "u/{}")]
)
def test_table(tmp_path, machine, short, suffix, position, command):
    columns = {"time_ms": np.arange(len(short.q)) * 20.0 + 5.0}
    columns |= {position.format(joint): short.q[:, i] for i, joint in enumerate(machine.joint_names)}
    columns |= {
        command.format(joint): np.resize(short.command[:, i], len(short.q))
        for i, joint in enumerate(machine.joint_names)
    }
    getattr(polars.DataFrame(columns), f"write_{suffix}")(tmp_path / f"a.{suffix}")
    drafted, raw, text = read_with_draft(tmp_path)
    assert drafted.joint_names == machine.joint_names and drafted.columns.time_unit == "ms"
    np.testing.assert_array_equal(raw.q, short.q)
    assert "50 Hz" in text


def test_time_units():
    times = np.arange(100) * 0.05
    assert [time_unit(times * scale) for scale in (1, 1e3, 1e6, 1e9)] == ["s", "ms", "us", "ns"]
    assert [time_unit((1.7e9 + times) * scale) for scale in (1, 1e3, 1e6, 1e9)] == ["s", "ms", "us", "ns"]


def test_unreadable_logs_are_named_and_the_others_described(tmp_path, machine, short):
    short.write(tmp_path / "good", machine)
    (tmp_path / "bad.mcap").write_bytes(b"no MCAP")
    (tmp_path / "bad.csv").write_bytes("t,q\n1,2\n".encode("utf-16"))
    contents = describe(tmp_path)
    assert (
        len(contents.failures) == 2
        and "bad.csv: its first line does not name columns" in contents.failures[0]
    )
    with pytest.raises(InputError, match=r"nothing can be read: .*bad\.mcap"):
        describe(tmp_path / "bad.mcap")


def test_can_with_the_dbc_file_beside(tmp_path, machine, short):
    can_logs.write(tmp_path / "a.blf", can_logs.frames(short, machine.joint_names))
    shutil.copy(MACHINE_DIRECTORY / "bobcat_e10.dbc", tmp_path)
    contents = describe(tmp_path)
    text = draft_machine(contents, "").replace("database: ???", f"database: {tmp_path}/bobcat_e10.dbc")
    drafted = filled_in(text)
    assert drafted.joint_names == machine.joint_names and drafted.command_kind == "discrete"
    raw = read_log(find_logs(tmp_path)[0], drafted)
    np.testing.assert_array_equal(raw.command, short.command)
    assert "position_swing" in (listed := "\n".join(listing(contents))) and "rad" in listed
    (tmp_path / "bobcat_e10.dbc").unlink()
    assert "0x280: CAN frame" in "\n".join(listing(describe(tmp_path)))


def test_lerobot_dataset(tmp_path, machine):
    whole_logs.write_dataset(tmp_path / "arm")
    drafted, raw, text = read_with_draft(tmp_path)
    assert drafted.joint_names == machine.joint_names and len(raw.q) == 600
    assert "observation.state.swing" in text and "50 Hz" in text


def test_what_is_not_known_is_left_to_the_user(tmp_path):
    twist = foreign.joint_state(foreign.ROS2, 1, ["a", "b"], [0.1, 0.2])
    foreign.write_mcap(tmp_path / "a.mcap", [(10**9, "/joint_states", twist)])
    draft = draft_machine(describe(tmp_path), "two")
    assert "name: two" in draft and 'commands:\n  topic: "???"' in draft


def test_command(tmp_path, machine, short):
    short.write(tmp_path / "logs" / "a", machine)
    result = run_stage("describe", "logs=logs", "output=mine.yaml", folder=tmp_path)
    assert result.returncode == 0, result.stderr
    order = "joints: swing, boom, arm, bucket; the values of commands follow this order"
    assert (
        order in result.stdout
        and "# Order: the values of commands follow" in (tmp_path / "mine.yaml").read_text()
    )
    move = f"move it to {MACHINE_DIRECTORY / 'mine.yaml'}, then ingest with machine=mine"
    assert f"replace every ???, check the guesses, {move}" in result.stdout
    assert filled_in((tmp_path / "mine.yaml").read_text()).name == "mine"


def test_a_draft_with_gaps_left_is_refused_in_one_line_and_a_file_is_not_overwritten(tmp_path):
    machine = tmp_path / "machine.yaml"
    twist = foreign.joint_state(foreign.ROS2, 1, ["a", "b"], [0.1, 0.2])
    foreign.write_mcap(tmp_path / "logs" / "a.mcap", [(10**9, "/joint_states", twist)])
    words = [f"logs={tmp_path / 'logs'}", f"output={machine}"]
    assert run_stage("describe", *words, folder=tmp_path).returncode == 0
    joints = yaml.safe_load(machine.read_text())["joints"]
    assert [joint["lower"] for joint in joints] == ["???", "???"]  # OmegaConf's sign of a missing value
    again = run_stage("describe", *words, folder=tmp_path)
    assert again.returncode == 2 and "is there already" in again.stderr


def test_an_unreadable_part_of_a_split_bag_is_told(tmp_path, machine, short):
    for number in range(2):
        short.write(tmp_path / "parts", machine)
        (part,) = (tmp_path / "parts").glob("*.mcap")
        (tmp_path / "run").mkdir(exist_ok=True)
        part.rename(tmp_path / "run" / f"run_{number}.mcap")
        shutil.rmtree(tmp_path / "parts")
    (tmp_path / "run/run_1.mcap").write_bytes(b"no MCAP")
    (log,) = describe(tmp_path).logs
    assert "; damage: run: the file is lost: run_1.mcap: not an MCAP file" in log


@pytest.mark.parametrize(("interval_s", "rate_hz"), [(1 / 18.86, 20), (0.02, 20), (0.11, 10), (0.25, 5)])
def test_the_rate_is_a_round_figure(tmp_path, interval_s, rate_hz):
    states = [
        (t, "/joint_states", foreign.joint_state(foreign.ROS2, t, ["a", "b"], [0.1, 0.2]))
        for t in (10**9 + np.arange(9) * round(interval_s * 1e9)).tolist()
    ]
    foreign.write_mcap(tmp_path / "a.mcap", states)
    draft = draft_machine(describe(tmp_path), "two")
    assert f"\nrate_hz: {rate_hz}  # a guess" in draft and f"come at {1 / interval_s:.4g} Hz" in draft


def test_work_and_memory_do_not_grow_with_names(tmp_path, machine, short):
    """A message that names 20,000 joints, and a table of 1,000 columns."""
    names = [f"j{number}" for number in range(20_000)]
    states = [
        (t, "/joint_states", foreign.joint_state(foreign.ROS2, t, order, np.zeros(len(names))))
        for t, order in ((10**9, names), (2 * 10**9, names[::-1]))
    ]
    foreign.write_mcap(tmp_path / "a.mcap", states)
    table = {"t": [0.0, 0.1]} | {f"{what}_x{number}": [0.0, 1.0] for number in range(500) for what in "qa"}
    polars.DataFrame(table).write_parquet(tmp_path / "b.parquet")
    begin = time.process_time()
    contents = describe(tmp_path)
    (states, table) = contents.streams.values()
    assert table.n_messages == 2 and len(states.names) <= 64
    assert "x499" in draft_machine(describe(tmp_path / "b.parquet"), "")
    assert time.process_time() - begin < 5


def test_frames_of_very_many_kinds_are_counted_together(tmp_path):
    frames = [
        can.Message(timestamp=number * 1e-3, arbitration_id=number % 1200, data=b"1", is_extended_id=True)
        for number in range(6000)
    ]
    can_logs.write(tmp_path / "a.blf", frames)
    streams = describe(tmp_path).streams.values()
    assert len(streams) == 1001 and sum(stream.n_messages for stream in streams) == 6000
    assert list(streams)[-1].name == "all others than the first 1000" and list(streams)[-1].n_messages == 1000


def test_times_in_text_are_named(tmp_path):
    (tmp_path / "a.csv").write_text("t,q_a,u_a\n2023-11-14 22:13:20,0.1,0\n2023-11-14 22:13:21,0.2,1\n")
    draft = draft_machine(describe(tmp_path), "")
    assert "  time: t  # holds text, and dates in text are not read" in draft
    assert "# Joint samples come at a rate that could not be measured." in draft


def test_a_byte_that_is_no_text_does_not_hide_the_table(tmp_path):
    """As ingest reads it."""
    (tmp_path / "a.csv").write_bytes(b"t,q_a,operator\n0.0,0.1,J\xf6rg\n0.1,0.2,Ann\n")
    (stream,) = describe(tmp_path).streams.values()
    assert stream.n_messages == 2 and list(stream.fields) == ["t", "q_a", "operator"]
