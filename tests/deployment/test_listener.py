"""A listener at a graph that does not come up, or whose nodes end: what it says, and what it keeps."""

import itertools
from collections import defaultdict
from unittest.mock import Mock

import pytest

from pipeline.deployment.messages import JointState, Topic
from pipeline.deployment.ros1 import listener as module
from pipeline.deployment.ros1.listener import Listener, wait_until_up
from pipeline.errors import InputError
from tests.deployment.machines import MIDDLE, bobcat


def test_a_node_that_ended_is_no_time_out() -> None:
    with pytest.raises(InputError, match="a node ended while the graph came up"):
        wait_until_up(lambda: False, "4 nodes", 300.0, is_running=lambda: False)
    with pytest.raises(InputError, match="4 nodes did not come up within"):
        wait_until_up(lambda: False, "4 nodes", 0.01, is_running=lambda: True)


def test_waiting_ends_once_it_is_there() -> None:
    tries = itertools.count()
    wait_until_up(lambda: next(tries) == 2, "4 nodes", 300.0, is_running=lambda: True)
    assert next(tries) == 3


def test_what_was_heard_until_a_node_ended_is_kept_and_nothing_after(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("require_ros", "GraphClock"):  # no graph to join
        monkeypatch.setattr(module, name, Mock())
    monkeypatch.setattr(module, "carriers", lambda machine: defaultdict(Mock))
    listener = Listener(bobcat(), "recorder", taps=[tap := Mock()])
    state = JointState(0, MIDDLE, 0 * MIDDLE)
    listener._keep(Topic.joint_states, state, 0)
    with pytest.raises(InputError, match="a node ended before its time"):
        listener.listen(300.0, is_running=lambda: False)
    listener._keep(Topic.joint_states, state, 1)
    assert listener.recorder.states == [(0, state)] and tap.call_count == 1
