"""The message index makes reading faster and must never change what is read."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from pipeline.logs import mcap_file
from pipeline.logs.bags import read_log
from pipeline.logs.discover import find_logs
from tests.logs import foreign_bags as foreign
from tests.logs.conftest import make_session, with_targets

MESSAGE_INDEX = 7


@pytest.fixture(scope="module")
def bag(tmp_path_factory, machine):
    path = tmp_path_factory.mktemp("indexed") / "a.mcap"
    session = with_targets(make_session(machine, seconds=10))
    foreign.write_mcap(path, foreign.messages(foreign.ROS2, session, machine.joint_names))
    return path


def read(path, machine):
    return read_log(find_logs(path)[0], machine)


def assert_alike(one, other):
    for field in ("joint_stamp_ns", "joint_log_time_ns", "q", "command_log_time_ns", "command"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field))
    assert one.message_counts == other.message_counts and one.notes == other.notes


def test_index_is_used_and_gives_what_the_walk_gives(bag, machine, monkeypatch):
    indexed = read(bag, machine)
    monkeypatch.setattr(mcap_file, "find_messages", lambda *_: None)
    assert_alike(indexed, read(bag, machine))
    monkeypatch.undo()
    calls = []
    monkeypatch.setattr(mcap_file.BlockColumns, "add", lambda *arguments: calls.append(arguments))
    assert_alike(indexed, read(bag, machine))
    assert not calls, "messages were walked one by one although the file has an index"


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_lying_index_changes_nothing(bag, tmp_path, machine, data):
    content = bytearray(bag.read_bytes())
    with bag.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    for _ in range(data.draw(st.integers(1, 6))):
        chunk = data.draw(st.sampled_from(chunks))
        start = chunk.message_index_offsets[data.draw(st.sampled_from(sorted(chunk.message_index_offsets)))]
        assert content[start] == MESSAGE_INDEX
        n_bytes = int.from_bytes(
            content[start + 11 : start + 15], "little"
        )  # of the entries, behind the head
        content[start + 15 + data.draw(st.integers(0, n_bytes - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    assert_alike(read(path, machine), read(bag, machine))
