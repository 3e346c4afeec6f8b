"""A graph whose nodes are killed: `python -m tests.deployment.ros_kills FOLDER PORT RULES`.

The machine is not part of it, as in reality: its PLC is somebody else's, at the other end of the bus. Stops are reset,
goals are given one after the other, and all is recorded as it is heard.
"""

import json
import os
import sys
import time
from pathlib import Path

from pipeline.configuration.load import load_machine
from pipeline.deployment.messages import Reset, SupervisorState, Topic
from pipeline.deployment.transports.ros1.installation import require_ros
from pipeline.deployment.transports.ros1.launch import graph
from pipeline.deployment.transports.ros1.message_types import carriers
from pipeline.deployment.transports.ros1.operator import Operator
from pipeline.deployment.transports.unfinished_bag import UnfinishedBag, unfinished
from pipeline.files.atomic import write_whole
from tests.deployment.ros_node import CAN, NODES
from tests.deployment.ros_trial import START_S, goal

KILLED = (*NODES, *CAN[1:])  # all but the PLC
OPERATOR, PIDS, BAG = "operator", "pids.json", "logs/kills"
POLL_S = 0.05


def run(folder: Path, port: str, rules: str) -> None:
    """Until somebody ends it."""
    rospy, machine = require_ros(), load_machine("bobcat_e10")
    commands = {
        name: [sys.executable, "-m", "tests.deployment.ros_node", name, str(folder), port, rules]
        for name in KILLED
    }
    with graph(commands, folder) as processes:
        operator = Operator(machine, [UnfinishedBag(unfinished(folder / BAG), machine)])
        carrier = carriers(machine)
        signs: list[SupervisorState] = []
        state, reset = carrier[Topic.supervisor_state], carrier[Topic.reset]
        rospy.Subscriber(
            state.name, state.ros_type, lambda ros: signs.append(state.from_ros(ros, operator.now_ns()))
        )
        resets = rospy.Publisher(reset.name, reset.ros_type, queue_size=10)
        operator.wait_for_server(START_S, lambda: None)
        pids = {name: process.pid for name, process in processes.items()} | {OPERATOR: os.getpid()}
        write_whole(folder / PIDS, json.dumps(pids).encode())
        pursued, number = False, 0
        while True:
            if signs and signs[-1].rule:
                now_ns = operator.now_ns()
                resets.publish(reset.to_ros(Reset(now_ns, signs[-1].stop_ns)))
                pursued = False
            elif not pursued:
                number += 1
                operator.give(goal(number))
                pursued = True
            if pursued and operator.client.result(POLL_S) is not None:
                pursued = False
            time.sleep(POLL_S)


if __name__ == "__main__":
    run(Path(sys.argv[1]), *sys.argv[2:])
