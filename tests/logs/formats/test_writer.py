import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from tests.logs.conftest import make_session, with_targets


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_what_is_written_is_read(tmp_path, machine, session, compression):
    full = with_targets(session)
    full.write(tmp_path / "bag", machine, compression=compression)
    raw = read_log(find_logs(tmp_path)[0], machine)
    assert raw.name == "bag" and raw.notes == ()
    np.testing.assert_array_equal(raw.joint_stamp_ns, full.stamp_ns)
    np.testing.assert_array_equal(raw.q, full.q)
    np.testing.assert_array_equal(raw.command_log_time_ns, full.command_ns)
    np.testing.assert_array_equal(raw.command, full.command)
    np.testing.assert_array_equal(raw.targets.position, full.targets.position)
    np.testing.assert_array_equal(raw.targets.quaternion, full.targets.quaternion)
    assert raw.targets.frame_id == "base"


def test_rosbags_reads_the_same(tmp_path, machine, session):
    """The folder is a genuine ROS 2 bag to another reader, definitions, hashes and metadata included."""
    session.write(tmp_path / "bag", machine)
    stamps, positions, commands = [], [], []
    with AnyReader([tmp_path / "bag"]) as reader:
        assert reader.message_count == len(session.q) + len(session.command)
        assert reader.start_time == min(session.log_time_ns[0], session.command_ns[0])
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            if connection.topic == "/joint_states":
                assert tuple(message.name) == machine.joint_names
                stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
                positions.append(message.position)
            else:
                assert connection.msgtype == "std_msgs/msg/Int8MultiArray"
                commands.append(message.data)
    np.testing.assert_array_equal(stamps, session.stamp_ns)
    np.testing.assert_array_equal(positions, session.q)
    np.testing.assert_array_equal(commands, session.command)


def test_mcap_library_validates_checksums(tmp_path, machine, session):
    session.write(tmp_path / "bag", machine)
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        n_messages = sum(1 for _ in reader.iter_messages())
        assert reader.get_header().profile == "ros2"
    assert n_messages == len(session.q) + len(session.command)


def test_bytes_depend_on_the_input_alone(tmp_path, machine, session):
    first, second = (
        session.write(tmp_path / "1" / "bag", machine),
        session.write(tmp_path / "2" / "bag", machine),
    )
    for name in ("bag_0.mcap", "metadata.yaml"):
        assert (first / name).read_bytes() == (second / name).read_bytes()


def test_existing_folder_is_not_touched(tmp_path, machine, session):
    session.write(tmp_path / "bag", machine)
    with pytest.raises(InputError, match="exists already"):
        session.write(tmp_path / "bag", machine)
    with pytest.raises(InputError, match="compression `zip`"):
        session.write(tmp_path / "other", machine, compression="zip")


def test_permuted_names_and_extra_joints(tmp_path, machine, session):
    extra = np.column_stack([session.q, np.full(len(session.q), 7.0)])
    names = (*machine.joint_names, "hammer")
    order = [2, 4, 0, 3, 1]
    session.write(tmp_path / "bag", machine, joint_names=[names[i] for i in order], positions=extra[:, order])
    np.testing.assert_array_equal(read_log(find_logs(tmp_path)[0], machine).q, session.q)


def test_continuous_machine_writes_floats(tmp_path, continuous_machine):
    session = make_session(continuous_machine)
    command = np.float32(np.random.default_rng(1).uniform(-1, 1, session.command.shape))
    session.write(tmp_path / "bag", continuous_machine, commands=command)
    np.testing.assert_array_equal(read_log(find_logs(tmp_path)[0], continuous_machine).command, command)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_any_values_survive(tmp_path_factory, machine, data):
    n, m = data.draw(st.integers(1, 20)), data.draw(st.integers(1, 20))
    times = st.integers(0, 2**31 * 10**9 - 1)
    stamp = np.array(data.draw(st.lists(times, min_size=n, max_size=n)), np.int64)
    log_time = np.array(data.draw(st.lists(times, min_size=n, max_size=n)), np.int64)
    command_ns = np.array(data.draw(st.lists(times, min_size=m, max_size=m)), np.int64)
    q = data.draw(hnp.arrays(np.float64, (n, machine.n_joint), elements=st.floats(width=64)))
    command = data.draw(hnp.arrays(np.int8, (m, machine.n_joint)))
    folder = tmp_path_factory.mktemp("any")
    session = make_session(machine, seconds=1)
    session.write(
        folder / "bag",
        machine,
        joint_state_header_stamp_ns=stamp,
        joint_state_log_time_ns=log_time,
        positions=q,
        command_log_time_ns=command_ns,
        commands=command,
    )
    raw = read_log(find_logs(folder)[0], machine)
    order, command_order = np.argsort(log_time, kind="stable"), np.argsort(command_ns, kind="stable")
    np.testing.assert_array_equal(raw.joint_stamp_ns, stamp[order])
    np.testing.assert_array_equal(raw.joint_log_time_ns, log_time[order])
    np.testing.assert_array_equal(raw.q, q[order])
    np.testing.assert_array_equal(raw.command, command[command_order])
