"""`machine_watch` as a ROS node, `python -m tests.deployment.ros_watch STATE`, and the session that it hears of."""

import dataclasses
import sys
import time
from functools import partial
from pathlib import Path

from pipeline.deployment.components.machine_watch import MachineWatch
from pipeline.deployment.messages import JointState, MachineCommand, Status, Topic
from pipeline.deployment.transports.ros1.installation import require_ros
from pipeline.deployment.transports.ros1.launch import graph, require_running
from pipeline.deployment.transports.ros1.listener import Listener
from pipeline.deployment.transports.ros1.message_types import carriers
from pipeline.deployment.transports.ros1.node import Node
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.messages.columns import as_array
from pipeline.watch.watch_inputs import WatchSettings
from tests.watch.two_joints import DT_S, MACHINE, settings

START_S, POLL_S = 300.0, 0.05
EVERY_S = 5.0
JUDGED_S = 60.0  # after the session, on a busy computer


def impatient() -> WatchSettings:
    """Judges every few seconds of motion."""
    config = settings()
    return dataclasses.replace(config, watch=dataclasses.replace(config.watch, live_every_s=EVERY_S))


def drive(state: Path, bag: Path, folder: Path) -> list[Status]:
    """What the node tells while a bag's motion is published at the speed at which it was recorded, and after it."""
    (entry,) = find_logs(bag)
    raw, rospy = read_log(entry, MACHINE), require_ros()
    table = carriers(MACHINE)
    command = [sys.executable, "-m", "tests.deployment.ros_watch", str(state)]
    with graph({MachineWatch.name: command}, folder) as processes:
        all_running = partial(require_running, processes, folder)
        listener = Listener(MACHINE, "machine")
        listener.wait_for_nodes(1, START_S, all_running)
        publish = {
            topic: rospy.Publisher(table[topic].name, table[topic].ros_type, queue_size=10)
            for topic in MachineWatch.subscriptions
        }
        while min(of.get_num_connections() for of in publish.values()) < 2 or not said(listener):
            all_running()
            time.sleep(POLL_S)
        begin_s = time.monotonic()
        for row, (q, a) in enumerate(zip(as_array(raw.q), as_array(raw.command), strict=True)):
            time.sleep(max(begin_s + row * DT_S - time.monotonic(), 0.0))
            now_ns = listener.now_ns()
            for topic, message in (
                (Topic.joint_states, JointState(now_ns, q, 0 * q)),
                (Topic.joint_commands, MachineCommand(now_ns, a)),
            ):
                publish[topic].publish(table[topic].to_ros(message))
        deadline = time.monotonic() + JUDGED_S
        while time.monotonic() < deadline and not said(listener)[-1].text.startswith("healthy"):
            all_running()
            time.sleep(POLL_S)
    return said(listener)


def said(listener: Listener) -> list[Status]:
    return [
        status
        for told in listener.recorder.diagnostics
        for status in told.statuses
        if status.source == MachineWatch.name
    ]


if __name__ == "__main__":
    Node(MachineWatch(Path(sys.argv[1]), impatient()), MACHINE).spin()
