"""A listener at a graph that does not come up, or whose nodes end: what it says, and what it keeps."""

import itertools
import subprocess
from collections import defaultdict
from pathlib import Path
from unittest.mock import Mock

import pytest

from pipeline.deployment.messages import JointState, Topic
from pipeline.deployment.transports.ros1 import listener as module
from pipeline.deployment.transports.ros1.launch import require_running
from pipeline.deployment.transports.ros1.listener import Listener, wait_until_up
from pipeline.errors import InputError
from tests.deployment.machines import MIDDLE, bobcat


def _ended() -> None:
    raise InputError("it ended")


def test_the_node_that_ended_is_named_with_its_last_words(tmp_path: Path) -> None:
    processes = {
        "supervisor": subprocess.Popen(["sleep", "60"]),
        "server": subprocess.Popen(["true"]),
    }
    try:
        processes["server"].wait()
        (tmp_path / "server.log").write_text("it starts\nerror: no policy in /there\n\n")
        with pytest.raises(InputError, match=r"server ended .*: error: no policy in /there \(.*server.log\)"):
            require_running(processes, tmp_path)
        del processes["server"]
        require_running(processes, tmp_path)
    finally:
        for process in processes.values():
            process.kill()
            process.wait()


def test_a_node_that_ended_is_no_time_out() -> None:
    with pytest.raises(InputError, match="it ended"):
        wait_until_up(lambda: False, "4 nodes", 300.0, require_running=_ended)
    with pytest.raises(InputError, match="4 nodes did not come up within"):
        wait_until_up(lambda: False, "4 nodes", 0.01, require_running=lambda: None)


def test_waiting_ends_once_it_is_there() -> None:
    tries = itertools.count()
    wait_until_up(lambda: next(tries) == 2, "4 nodes", 300.0, require_running=lambda: None)
    assert next(tries) == 3


def test_what_was_heard_until_a_node_ended_is_kept_and_nothing_after(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("require_ros", "GraphClock"):  # no graph to join
        monkeypatch.setattr(module, name, Mock())
    monkeypatch.setattr(module, "carriers", lambda machine: defaultdict(Mock))
    listener = Listener(bobcat(), "recorder", taps=[tap := Mock()])
    state = JointState(0, MIDDLE, 0 * MIDDLE)
    listener._keep(Topic.joint_states, state, 0)
    with pytest.raises(InputError, match="it ended"):
        listener.listen(300.0, require_running=_ended)
    listener._keep(Topic.joint_states, state, 1)
    assert listener.recorder.states == [(0, state)] and tap.call_count == 1
