"""`machine_watch` as a node of the ROS graph, which a session is played to."""

from pathlib import Path

import pytest

from pipeline.deployment.messages import Level
from pipeline.deployment.transports.own_process import in_own_process
from tests.deployment.ros_watch import drive
from tests.deployment.test_ros_trial import PACKAGES
from tests.ros_graph import requires_debian
from tests.watch.two_joints import learn, write_session


@pytest.mark.long
@requires_debian(PACKAGES)
def test_the_node_tells_of_a_session_in_progress(tmp_path: Path) -> None:
    learn(tmp_path)
    bag = write_session(tmp_path / "new", 11, minutes=0.5)
    said = in_own_process(drive, tmp_path / "state", bag, tmp_path / "graph")
    assert said[0].text == "unestimated, 0 of 5 s of motion"
    assert said[-1].text.startswith("healthy, evidence ") and said[-1].level is Level.ok
    assert "moved 8.0 of 8 s" in said[-1].values["turn"]
