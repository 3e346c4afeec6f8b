"""The running graph in Foxglove and browsers: a tap that converts its messages to the topics of stage `view`."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jinja2 import StrictUndefined, Template

from pipeline.deployment.component import nanoseconds
from pipeline.deployment.components.recording import Recorder
from pipeline.deployment.messages import JointState, Message, Topic
from pipeline.deployment.settings import CoverageConfig
from pipeline.deployment.transports.simulated_time.graph import Tap
from pipeline.deployment.viewing.coverage import ReachableCells
from pipeline.deployment.viewing.live_server import Channel, LiveServer
from pipeline.deployment.viewing.painting import PAINTED_TOPICS, Painting
from pipeline.deployment.viewing.painting import PERIOD_NS as PAINTING_PERIOD_NS
from pipeline.deployment.viewing.ros_messages import STORE
from pipeline.deployment.viewing.visual_topics import TOPICS, changing_topics, constant_topics
from pipeline.logs.messages.raw_log import RawLog
from pipeline.machine.chain import arm_description
from pipeline.machine.kinematics import load_arm
from pipeline.machine.specification import MachineSpecification

PAGE = Path(__file__).with_name("painting.html.j2")
PERIOD_NS = nanoseconds(0.05)  # period of pictures; joint states come more often
PAIR = 2  # joint states of a picture: the newest, and an earlier one for its velocity


class LiveView:
    """Publishes a picture of the machine at most every 50 ms of the graph's time."""

    def __init__(
        self, server: LiveServer, machine: MachineSpecification, directory: Path, painting: Painting
    ) -> None:
        """Nothing is published before the first joint states.

        Args:
            server: server of the channels `visual_topics.TOPICS` and `painting.PAINTED_TOPICS`.
            machine: with arm and workspace.
            directory: where conf/machine lies.
            painting: to which all joint states are added.
        """
        self._server, self._painting = server, painting
        self._machine, self._directory = machine, directory
        self._heard = Recorder()
        self._due_ns: int | None = None
        self._painting_due_ns = 0

    def __call__(self, topic: Topic, message: Message, time_ns: int) -> None:
        """Process a message."""
        heard = self._heard
        heard(topic, message, time_ns)
        if isinstance(message, JointState):
            self._painting.add(message.position[None])
        if topic is not Topic.joint_states or len(heard.states) < PAIR:
            return
        if self._due_ns is None:
            for standing in constant_topics(self._machine, self._directory, time_ns):
                self._server.publish(standing.name, *standing.messages[-1])
        elif time_ns < self._due_ns:
            del heard.states[:-PAIR]
            return
        self._due_ns = time_ns + PERIOD_NS
        record = heard.graph_record()
        for moving in changing_topics(self._log(), record, self._machine, self._directory):
            newest = moving.messages[-1:] if moving.name in ("/tf", "/joints") else moving.messages
            for message_ns, content in newest:
                self._server.publish(moving.name, message_ns, content)
        if time_ns >= self._painting_due_ns:
            self._painting_due_ns = time_ns + PAINTING_PERIOD_NS
            for painted in self._painting.topics(time_ns):
                self._server.publish(painted.name, *painted.messages[0])
        self._heard = Recorder(states=heard.states[-1:], commands=heard.commands[-1:])

    def _log(self) -> RawLog:
        states, commands = self._heard.states[-PAIR:], self._heard.commands
        n_joint = self._machine.n_joint
        times_ns = np.array([time_ns for time_ns, _ in states], np.int64)
        return RawLog(
            "live",
            Path(),
            times_ns,
            times_ns,
            np.array([state.position for _, state in states], float),
            np.array([time_ns for time_ns, _ in commands], np.int64),
            np.array([command.values for _, command in commands], float).reshape(-1, n_joint),
            self._heard.target_poses() if self._heard.targets else None,
        )


def page_of(machine: MachineSpecification) -> bytes:
    """The page that draws a machine with an arm in a browser, self-contained HTML."""
    template = Template(PAGE.read_text(encoding="utf-8"), undefined=StrictUndefined)
    return template.render(end_effector=arm_description(machine).end_effector).encode()


@contextlib.contextmanager
def live_view(
    machine: MachineSpecification, directory: Path, coverage: CoverageConfig, port: int | None
) -> Iterator[list[Tap]]:
    """A tap that shows the graph on a port of this computer; an empty list without a port.

    Raises:
        InputError: the port is taken, or the machine has no arm or no workspace.
    """
    if port is None:
        yield []
        return
    painting = Painting(ReachableCells(machine, load_arm(machine, directory), coverage))
    channels = [Channel(name, type_name) for name, type_name in (TOPICS | PAINTED_TOPICS).items()]
    with LiveServer(port, STORE, channels, page_of(machine)) as server:
        print(
            f"watch it in a browser at http://{server.place}/, or in Foxglove: Open connection, Foxglove WebSocket, "
            f"ws://{server.place}",
            flush=True,
        )
        yield [LiveView(server, machine, directory, painting)]
