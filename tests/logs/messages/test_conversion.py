"""Positions in degrees, commands in volts, in bags and tables, against conversions done before recording."""

from dataclasses import replace

import numpy as np
import polars
import pytest

from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.messages.conversion import Conversion, discretise
from pipeline.machine.log_sources import CommandSource, CommandSourceKind, JointStateSource
from pipeline.machine.specification import CommandKind, MachineSpecification
from tests.logs.conftest import Session, make_session
from tests.logs.samples import foreign_bags as foreign

OFFSET = [0.1, -0.2, 0.3, 0.0]  # rad
VOLTS = [10.0, 5.0, -12.0, 24.0]


@pytest.fixture(scope="module")
def short(machine) -> Session:
    return make_session(machine, seconds=3)


@pytest.fixture
def in_degrees(machine) -> MachineSpecification:
    """Encoders in degrees with an offset each; valves in volts, whose full command differs by joint."""
    return replace(
        machine,
        command_kind=CommandKind.continuous,
        joint_states=JointStateSource(scale=[np.pi / 180], offset=OFFSET),
        commands=CommandSource(scale=[1 / volts for volts in VOLTS]),
    )


def read(folder, machine):
    (entry,) = find_logs(folder)
    return read_log(entry, machine)


def assert_converted(raw, session):
    np.testing.assert_allclose(raw.q, session.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(raw.command, session.command, rtol=0, atol=1e-6)


def test_a_bag_in_degrees_and_volts(short, machine, in_degrees, tmp_path):
    other = replace(short, q=np.degrees(short.q - OFFSET), command=short.command * VOLTS)
    states = foreign.messages(foreign.ROS2, other, machine.joint_names)
    entries = [entry for entry in states if entry[1] == "/joint_states"]
    entries += [
        (int(time), "/joint_commands", foreign.array(foreign.ROS2, values, "Float32"))
        for time, values in zip(other.command_ns, other.command, strict=True)
    ]
    foreign.write_mcap(tmp_path / "a.mcap", sorted(entries, key=lambda entry: entry[0]))
    assert_converted(read(tmp_path, in_degrees), short)


def test_a_table_in_degrees_and_volts(short, in_degrees, tmp_path):
    names, n_rows = in_degrees.joint_names, len(short.command)
    positions, commands = np.degrees(short.q[:n_rows] - OFFSET), short.command * VOLTS
    columns = {"t": 0.05 * np.arange(n_rows)}
    columns |= {f"q_{joint}": positions[:, number] for number, joint in enumerate(names)}
    columns |= {f"a_{joint}": commands[:, number] for number, joint in enumerate(names)}
    polars.DataFrame(columns).write_csv(tmp_path / "a.csv")
    assert_converted(read(tmp_path, in_degrees), replace(short, q=short.q[:n_rows]))


def test_own_bags_of_such_a_machine_are_read_as_they_were_written(short, in_degrees, tmp_path):
    short.write(tmp_path / "bag", in_degrees)
    assert_converted(read(tmp_path / "bag", in_degrees), short)


def test_a_threshold_comes_after_the_scale(short, machine, tmp_path):
    volts = replace(machine, commands=CommandSource(scale=[0.1], threshold=0.5))
    short.write(
        tmp_path / "bag", replace(volts, command_kind=CommandKind.continuous), commands=short.command * 0.7
    )
    np.testing.assert_array_equal(read(tmp_path / "bag", volts).command, short.command)


def test_a_joystick_in_counts(short, machine, tmp_path):
    source = CommandSource(
        source=CommandSourceKind.joy,
        axes=[0, 1, 2, 3],
        signs=[1, 1, -1, 1],
        threshold=0.4,
        scale=[1 / 512],
        offset=[-1.0],
    )
    entries = [
        entry
        for entry in foreign.messages(foreign.ROS2, short, machine.joint_names)
        if entry[1] == "/joint_states"
    ]
    entries += [
        (
            int(time),
            "/joint_commands",
            foreign.joy(foreign.ROS2, int(time), 512 * (1 + 0.5 * values) * [1, 1, -1, 1]),
        )
        for time, values in zip(short.command_ns, short.command, strict=True)
    ]
    foreign.write_mcap(tmp_path / "a.mcap", sorted(entries, key=lambda entry: entry[0]))
    np.testing.assert_array_equal(read(tmp_path, replace(machine, commands=source)).command, short.command)


def test_without_scale_and_offset_no_bit_changes():
    numbers = np.array([[-0.0, np.nan, 1e-320, 5.0]])
    assert Conversion()(numbers) is numbers


def test_what_is_not_a_number_stays_so():
    np.testing.assert_array_equal(discretise(np.array([np.nan, 0.5, -0.6]), 0.5), [np.nan, 0.0, -1.0])


@pytest.mark.parametrize(
    ("section", "values", "said"),
    [
        ("joint_states", {"scale": [1.0, 2.0]}, r"bobcat_e10.yaml: joint_states.scale has 2 entries"),
        ("joint_states", {"scale": [0.0]}, "scale holds 0"),
        (
            "commands",
            {"offset": [1.0] * 5},
            r"commands.offset has 5 entries; list one per joint \(4\), or one for all",
        ),
    ],
)
def test_wrong_lists_are_refused(short, machine, tmp_path, section, values, said):
    source = {"joint_states": JointStateSource, "commands": CommandSource}[section](**values)
    short.write(tmp_path / "bag", machine)
    with pytest.raises(InputError, match=said):
        read(tmp_path / "bag", replace(machine, **{section: source}))
