"""A private ROS 1 graph for tests: Debian's `rosmaster` on a free port, nodes beside it, nothing left behind.

    with RosGraph(tmp_path) as graph:
        node = graph.start("talker", [DEBIAN_PYTHON, "talker.py"])
        graph.wait_for_publishers("/chatter")
        graph.stop(node)

The tests' own process imports nothing of ROS: it asks the master over XML-RPC. Nodes may run in Debian's
Python, be ROS's own programs, or run in this Python with `DIST_PACKAGES` at the end of `sys.path` (not in
PYTHONPATH, which would put Debian's NumPy before ours).
"""

import contextlib
import http.client
import os
import signal
import socket
import subprocess
import time
import xmlrpc.client
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import pytest

DEBIAN_PYTHON = "/usr/bin/python3"
DIST_PACKAGES = Path("/usr/lib/python3/dist-packages")
ROSMASTER = "/usr/bin/rosmaster"
ROSBAG = "/usr/bin/rosbag"
ROSBAG_RECORD = "/usr/lib/rosbag/record"  # the node that `rosbag record` starts

# What .ci/run installs, and a file by which each package is known to be there.
DEBIAN_PACKAGES = {
    "python3-rosbag": Path(ROSBAG_RECORD),  # the recorder, `rosbag`, and rospy by dependency
    "python3-rosmaster": Path(ROSMASTER),
    "python3-sensor-msgs": DIST_PACKAGES / "sensor_msgs",  # std_msgs and geometry_msgs by dependency
}

HOST = "127.0.0.1"
CALLER = "/tests"  # our name in questions to the master and to nodes
SUCCESS, OUTBOUND = 1, "o"  # in their answers
MASTER_STARTS = 3  # another process may take the free port before the master does
START_TIMEOUT_S = 20.0
CALL_TIMEOUT_S = 5.0  # of one question to the master
STOP_TIMEOUT_S = 10.0  # until a node that was asked to end is killed
POLL_S = 0.02
LOG_TAIL_CHARACTERS = 2000


def requires_debian(packages: dict[str, Path] = DEBIAN_PACKAGES) -> pytest.MarkDecorator:
    """Return the mark that skips a test, with the command to run, where Debian packages are missing.

    Args:
        packages: A file that tells of each package.
    """
    missing = [package for package, path in packages.items() if not path.exists()]
    remedy = f"apt-get install --no-install-recommends {' '.join(missing)}"
    return pytest.mark.skipif(bool(missing), reason=f"ROS 1 is not installed (Debian: {remedy})")


class RosGraphError(AssertionError):
    """The graph did not do what a test waited for; the text ends with what the nodes printed."""


@dataclass(frozen=True)
class Node:
    """A process of the graph, leader of a process group of its own.

    Attributes:
        name: For messages; a ROS program's node name is its own affair.
        process: Its first process, which leads the group.
        output: The file that takes what it prints.
    """

    name: str
    process: subprocess.Popen
    output: Path

    def has_ended(self) -> bool:
        """Whether it ended; its process number stays taken until `reap`."""
        if self.process.returncode is not None:
            return True
        flags = os.WEXITED | os.WNOHANG | os.WNOWAIT
        return os.waitid(os.P_PID, self.process.pid, flags) is not None

    def signal(self, number: int) -> None:
        """Send a signal to it and to whatever it started."""
        if self.process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process.pid, number)

    def reap(self) -> int:
        """Kill what is left of its process group and return its exit status."""
        self.signal(signal.SIGKILL)
        return self.process.wait()


class RosGraph:
    """A ROS master and its nodes, as a context manager.

    All waits end in time: a `RosGraphError` says what did not happen. Leaving the context stops the nodes
    and then the master; where one does not end in time, its process group is killed. If
    the tests' process itself is killed, the kernel kills the nodes.

    Attributes:
        folder: For logs and node output; ROS writes nothing elsewhere.
        environment: What nodes of this graph need in theirs.
        uri: Where the master answers.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environment: dict[str, str] = {}
        self.uri = ""
        self.nodes: list[Node] = []

    def __enter__(self) -> Self:
        self.folder.mkdir(parents=True, exist_ok=True)
        try:
            for _ in range(MASTER_STARTS):
                if self._start_master():
                    return self
            raise RosGraphError(f"no ROS master came up in {MASTER_STARTS} starts{self._printed()}")
        except BaseException:
            self.__exit__()
            raise

    def __exit__(self, *_: object) -> None:
        try:
            self.stop(*self.nodes[:0:-1])
            self.stop(*self.nodes[:1])
        finally:
            for node in self.nodes:
                node.reap()

    def start(self, name: str, command: Sequence[str | Path]) -> Node:
        """Start a node.

        Args:
            name: For messages and the name of its output file.
            command: Program and arguments.
        """
        output = self.folder / f"{len(self.nodes)}_{name}.txt"
        with output.open("wb") as file:
            process = subprocess.Popen(
                ["setpriv", "--pdeathsig", "KILL", "--", *map(str, command)],
                cwd=self.folder,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        node = Node(name, process, output)
        self.nodes.append(node)
        return node

    def stop(self, *nodes: Node, number: int = signal.SIGINT, timeout_s: float = STOP_TIMEOUT_S) -> list[int]:
        """End nodes side by side and return their exit statuses, negative where a signal ended them.

        Args:
            nodes: Which; those that ended already are allowed.
            number: The signal that asks them to; SIGKILL for a crash.
            timeout_s: After it they are killed.
        """
        for node in nodes:
            node.signal(number)
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline and not all(node.has_ended() for node in nodes):
            time.sleep(POLL_S)
        return [node.reap() for node in nodes]

    def wait_until(self, happened: Callable[[], bool], what: str, timeout_s: float = START_TIMEOUT_S) -> None:
        """Wait for something.

        Args:
            happened: Tells whether it did.
            what: What it is, for the message.
            timeout_s: How long to wait.

        Raises:
            RosGraphError: It did not happen in time.
        """
        deadline = time.monotonic() + timeout_s
        while not happened():
            if time.monotonic() > deadline:
                raise RosGraphError(f"after {timeout_s:g} s there is still no {what}{self._printed()}")
            time.sleep(POLL_S)

    def wait_for_publishers(self, topic: str, count: int = 1, timeout_s: float = START_TIMEOUT_S) -> None:
        """Wait until at least so many nodes publish a topic."""
        self._wait_for(self.publishers, "publishers", topic, count, timeout_s)

    def wait_for_subscribers(self, topic: str, count: int = 1, timeout_s: float = START_TIMEOUT_S) -> None:
        """Wait until at least so many nodes have subscribed to a topic."""
        self._wait_for(self.subscribers, "subscribers", topic, count, timeout_s)

    def wait_for_connections(
        self, publisher: str, topic: str, count: int = 1, timeout_s: float = START_TIMEOUT_S
    ) -> None:
        """Wait until a node sends a topic to at least so many subscribers: from then on they miss nothing.

        Args:
            publisher: The publishing node's ROS name, such as `/talker`.
            topic: What it publishes.
            count: How many subscribers.
            timeout_s: How long to wait.
        """

        def connected() -> bool:
            uri = _ask(self.uri, "lookupNode", publisher)
            lines = _ask(uri, "getBusInfo") if uri else None
            return sum(line[2] == OUTBOUND and line[4] == topic and line[5] for line in lines or []) >= count

        self.wait_until(connected, f"{count} connections from {publisher} for {topic}", timeout_s)

    def publishers(self, topic: str) -> list[str]:
        """Return the names of the nodes that publish a topic."""
        return self._registered(0, topic)

    def subscribers(self, topic: str) -> list[str]:
        """Return the names of the nodes that subscribed to a topic."""
        return self._registered(1, topic)

    def _wait_for(
        self, found: Callable[[str], list[str]], role: str, topic: str, count: int, timeout_s: float
    ) -> None:
        self.wait_until(lambda: len(found(topic)) >= count, f"{count} {role} of {topic}", timeout_s)

    def _registered(self, role: int, topic: str) -> list[str]:
        state = _ask(self.uri, "getSystemState")
        return next((nodes for name, nodes in state[role] if name == topic), []) if state else []

    def _start_master(self) -> bool:
        """Start the master on a free port; return whether it is this one that answers there."""
        with socket.socket() as free:
            free.bind((HOST, 0))
            port = free.getsockname()[1]
        self.uri = f"http://{HOST}:{port}"
        self.environment = _environment(self.uri, self.folder)
        master = self.start("rosmaster", [ROSMASTER, "--core", "-p", str(port)])
        answered = False

        def answers() -> bool:
            nonlocal answered
            answered = _ask(self.uri, "getPid") == master.process.pid
            return answered or master.has_ended()

        with contextlib.suppress(RosGraphError):
            self.wait_until(answers, "ROS master")
        if not answered:
            self.stop(self.nodes.pop())
        return answered

    def _printed(self) -> str:
        """What the nodes printed, for messages."""
        return "".join(_tail(self.nodes))


class _ImpatientTransport(xmlrpc.client.Transport):
    """XML-RPC that waits for an answer for a limited time."""

    def make_connection(self, host):
        connection: http.client.HTTPConnection = super().make_connection(host)
        connection.timeout = CALL_TIMEOUT_S
        return connection


def _ask(uri: str, question: str, *arguments: str) -> Any:
    """Put a question of ROS's master or slave API; None where no answer came (yet)."""
    with (
        contextlib.suppress(OSError, http.client.HTTPException, xmlrpc.client.Error),
        xmlrpc.client.ServerProxy(uri, transport=_ImpatientTransport()) as server,
    ):
        status, _, value = getattr(server, question)(CALLER, *arguments)
        return value if status == SUCCESS else None
    return None


def _environment(uri: str, folder: Path) -> dict[str, str]:
    """The environment of this graph's nodes: nothing of another ROS, another Python or the user's home."""
    inherited = {name: value for name, value in os.environ.items() if not name.startswith(("ROS", "PYTHON"))}
    return inherited | {
        "ROS_MASTER_URI": uri,
        "ROS_IP": HOST,
        "ROS_HOME": str(folder / "ros_home"),
        "ROS_LOG_DIR": str(folder / "ros_log"),
        "PYTHONUNBUFFERED": "1",
    }


def _tail(nodes: Iterable[Node]) -> Iterable[str]:
    for node in nodes:
        text = node.output.read_text(errors="replace")[-LOG_TAIL_CHARACTERS:].rstrip()
        state = f"ended with {node.process.poll()}" if node.has_ended() else "runs"
        yield f"\n--- {node.name} ({state})\n{text}"
