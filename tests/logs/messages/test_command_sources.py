import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import get_types_from_msg

from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.messages.conversion import discretise
from pipeline.machine.log_sources import CommandSource, CommandSourceKind
from pipeline.machine.specification import CommandKind
from tests.logs.conftest import load_machine, make_session
from tests.logs.samples import foreign_bags as foreign

STICKS = "float32 left\nfloat32 right\nfloat64[] pedals\n"
foreign.ROS2.register(get_types_from_msg(STICKS, "vendor/msg/Sticks"))


@pytest.fixture(scope="module")
def short(machine):
    return make_session(machine, seconds=3)


def read_with(tmp_path, short, source, make_message, kind=CommandKind.discrete):
    """Write the session's commands as other messages on /cmd, and read them with a source."""
    machine = load_machine("bobcat_e10")
    machine.commands, machine.command_kind = source, kind
    entries = [
        e for e in foreign.messages(foreign.ROS2, short, machine.joint_names) if e[1] == "/joint_states"
    ]
    entries += [
        (int(t), "/cmd", make_message(t, a)) for t, a in zip(short.command_ns, short.command, strict=True)
    ]
    foreign.write_mcap(tmp_path / "a.mcap", sorted(entries, key=lambda entry: entry[0]))
    return read_log(find_logs(tmp_path)[0], machine)


@pytest.mark.parametrize("number", ["Int8", "Int32", "Float32", "Float64"])
def test_arrays(tmp_path, short, number):
    raw = read_with(
        tmp_path, short, CommandSource(topic="/cmd"), lambda _, a: foreign.array(foreign.ROS2, a, number)
    )
    np.testing.assert_array_equal(raw.command, short.command)


def test_joystick_is_discretised_as_the_papers_interpreter(tmp_path, short):
    """Axes 4, 0, 1, 3 drive the joints, two of them reversed; beyond half deflection is full."""
    axes, signs = [4, 0, 1, 3], np.array([-1.0, 1.0, 1.0, -1.0])
    rng = np.random.default_rng(0)
    source = CommandSource("/cmd", CommandSourceKind.joy, axes=axes, signs=signs.tolist(), threshold=0.5)

    def make(t, a):
        stick = rng.uniform(-0.5, 0.5, 6)
        pushed = np.where(a != 0, a * rng.uniform(0.51, 1.0, 4), stick[axes] * signs) * signs
        stick[axes] = pushed
        return foreign.joy(foreign.ROS2, int(t), stick)

    np.testing.assert_array_equal(read_with(tmp_path, short, source, make).command, short.command)


def test_joystick_of_a_continuous_machine_keeps_its_values(tmp_path, short):
    source = CommandSource("/cmd", CommandSourceKind.joy, axes=[0, 1, 2, 3], signs=[1.0, -1.0, 1.0, 1.0])
    raw = read_with(
        tmp_path,
        short,
        source,
        lambda t, a: foreign.joy(foreign.ROS2, int(t), a * 0.25),
        CommandKind.continuous,
    )
    np.testing.assert_array_equal(raw.command, short.command * 0.25 * [1, -1, 1, 1])


@pytest.mark.parametrize("field", ["position", "velocity", "effort"])
def test_joint_state_by_name_and_field(tmp_path, short, machine, field):
    names = ["extra", *reversed(machine.joint_names)]
    source = CommandSource("/cmd", CommandSourceKind.joint_state, field_name=field)

    def make(t, a):
        values = {"position": np.full(5, 9.0), "velocity": np.full(5, 8.0), "effort": np.full(5, 7.0)}
        values[field] = [5.0, *a[::-1]]
        return foreign.joint_state(foreign.ROS2, int(t), names, **values)

    np.testing.assert_array_equal(read_with(tmp_path, short, source, make).command, short.command)


def test_field_paths_of_a_type_that_only_the_bag_knows(tmp_path, short):
    paths = ["left", "pedals[1]", "right", "pedals[0]"]
    sticks = foreign.ROS2.types["vendor/msg/Sticks"]
    source = CommandSource("/cmd", CommandSourceKind.field_path, field_paths=paths)
    raw = read_with(
        tmp_path,
        short,
        source,
        lambda t, a: sticks(left=a[0], right=a[2], pedals=np.array([a[3], a[1]], float)),
    )
    np.testing.assert_array_equal(raw.command, short.command)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (
            CommandSource("/joint_commands"),
            r"topic /joint_commands is not in the log.*seen: /cmd \(std_msgs.*Int8Multi",
        ),
        (
            CommandSource("/cmd", CommandSourceKind.joint_state),
            "std_msgs/msg/Int8MultiArray, not sensor_msgs",
        ),
        (CommandSource("/cmd", CommandSourceKind.field_path, field_paths=["x"] * 4), "no number field `x`"),
        (CommandSource("/cmd", CommandSourceKind.field_path, field_paths=["data[9]"] * 4), r"no `data\[9\]`"),
        (
            CommandSource("/cmd", CommandSourceKind.field_path, field_paths=["data"] * 4),
            "holds 4 values, not one",
        ),
        (CommandSource("/cmd", CommandSourceKind.field_path, field_paths=["data[0]"]), "list one per joint"),
        (CommandSource("/cmd", CommandSourceKind.joy, axes=[0], signs=[1.0]), r"axes has 1 entries"),
        (CommandSource("/cmd", CommandSourceKind.joint_state, field_name="force"), "field_name is `force`"),
    ],
)
def test_refuses_to_guess(tmp_path, short, source, words):
    with pytest.raises(InputError, match=words) as error:
        read_with(tmp_path, short, source, lambda _, a: foreign.array(foreign.ROS2, a))
    assert "\n" not in str(error.value)


def test_wrong_number_of_values(tmp_path, short):
    with pytest.raises(InputError, match="hold 3 values, the machine has 4 joints"):
        read_with(tmp_path, short, CommandSource("/cmd"), lambda _, a: foreign.array(foreign.ROS2, a[:3]))


def test_missing_joint_names_those_seen(tmp_path, short, machine):
    entries = foreign.messages(foreign.ROS2, short, ["swing", "boom", "stick", "bucket"])
    foreign.write_mcap(tmp_path / "a.mcap", entries)
    with pytest.raises(
        InputError, match="joint arm is missing; names in the messages: swing, boom, stick, bucket"
    ):
        read_log(find_logs(tmp_path)[0], machine)


def test_messages_with_other_joints_are_counted(tmp_path, short, machine):
    """A second publisher on the topic, for joints that are not the machine's."""
    entries = foreign.messages(foreign.ROS2, short, machine.joint_names)
    other = [
        (t + 1, "/joint_states", foreign.joint_state(foreign.ROS2, t, ["wheel"], [1.0]))
        for t, _, _ in entries[:7]
    ]
    foreign.write_mcap(tmp_path / "a.mcap", sorted(entries + other, key=lambda entry: entry[0]))
    raw = read_log(find_logs(tmp_path)[0], machine)
    np.testing.assert_array_equal(raw.q, short.q)
    (note,) = raw.notes
    assert note.count == 7 and "wheel" in note.text


def test_topic_of_two_types_is_ambiguous(tmp_path, short, machine):
    """Two publishers that disagree about the type, as ROS 2 lets them."""
    entries = foreign.messages(foreign.ROS2, short, machine.joint_names)
    first = foreign.write_mcap(tmp_path / "run" / "run_0.mcap", entries)
    floats = [
        (t, c, foreign.array(foreign.ROS2, m.data, "Float32") if c == "/joint_commands" else m)
        for t, c, m in entries
    ]
    foreign.write_mcap(first.with_name("run_1.mcap"), floats)
    with pytest.raises(
        InputError, match=r"several types \(std_msgs/msg/Float32MultiArray, std_msgs/msg/Int8MultiArray\)"
    ):
        read_log(find_logs(tmp_path)[0], machine)


@given(st.floats(-1, 1), st.floats(0, 1))
def test_discretise(value, threshold):
    expected = -1 if value < -threshold else 1 if value > threshold else 0
    assert discretise(np.array([value]), threshold)[0] == expected


TRAJECTORY = (
    "string[] joint_names\nvendor/Point[] points\n" + "=" * 80 + "\nMSG: vendor/Point\nfloat64[] velocities\n"
)
VALVES = "vendor/Valve[] valves\n" + "=" * 80 + "\nMSG: vendor/Valve\nstring id\nfloat32 duty\n"
foreign.ROS2.register(get_types_from_msg(TRAJECTORY, "vendor/msg/Trajectory"))
foreign.ROS2.register(get_types_from_msg(VALVES, "vendor/msg/Valves"))


def trajectory(names, values):
    """As `trajectory_msgs/JointTrajectory`: names once, values in the points."""
    types = foreign.ROS2.types
    point = types["vendor/msg/Point"](velocities=np.array(values, np.float64))
    return types["vendor/msg/Trajectory"](joint_names=list(names), points=[point])


def valves(names, values):
    types = foreign.ROS2.types
    listed = [
        types["vendor/msg/Valve"](id=name, duty=value) for name, value in zip(names, values, strict=True)
    ]
    return types["vendor/msg/Valves"](valves=listed)


@pytest.mark.parametrize(
    ("make", "names", "values"),
    [(trajectory, "joint_names", "points[0].velocities"), (valves, "valves[].id", "valves[].duty")],
)
def test_any_message_that_names_its_joints(tmp_path, short, machine, make, names, values):
    """In another order in every second message, with a joint more."""
    source = CommandSource(topic="/cmd", source=CommandSourceKind.named, names=names, values=values)
    order, number = [*machine.joint_names, "extra"], iter(range(10**6))

    def message(t, a):
        pairs = list(zip(order, [*a, 9.0], strict=True))
        pairs = pairs[::-1] if next(number) % 2 else pairs
        return make(*zip(*pairs, strict=True))

    np.testing.assert_array_equal(read_with(tmp_path, short, source, message).command, short.command)


def test_named_commands_say_what_is_missing(tmp_path, short, machine):
    source = CommandSource(
        topic="/cmd", source=CommandSourceKind.named, names="joint_names", values="points[0].velocities"
    )
    with pytest.raises(InputError, match="joint swing, boom is missing; names in the messages: arm, bucket"):
        read_with(tmp_path, short, source, lambda _, a: trajectory(["arm", "bucket"], a[2:]))
    (tmp_path / "a.mcap").unlink()
    with pytest.raises(InputError, match="holds 3 values for 4 names"):
        read_with(tmp_path, short, source, lambda _, a: trajectory(machine.joint_names, a[:3]))
    source.values = ""
    with pytest.raises(InputError, match=r"commands\.values is missing"):
        read_with(tmp_path, short, source, lambda _, a: trajectory(machine.joint_names, a))
