"""A ROS master and the graph's nodes, each in its own process; they end together."""

import contextlib
import os
import signal
import socket
import subprocess
import time
import xmlrpc.client
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from pipeline.deployment.transports.ros1.clock import CALLER, set_clock
from pipeline.deployment.transports.ros1.installation import ROSMASTER, require_ros
from pipeline.errors import InputError

HOST = "127.0.0.1"
START_S, STOP_S, POLL_S = 60.0, 30.0, 0.05
PARENT_DEATH_SIGNAL = (
    "setpriv",
    "--pdeathsig",
    "TERM",
    "--",
)  # Debian's tool; works even if this process is killed


@contextlib.contextmanager
def graph(nodes: Mapping[str, Sequence[str]], folder: Path) -> Iterator[dict[str, subprocess.Popen[bytes]]]:
    """Start a master on a free port and the nodes' commands; stop them at the end.

    Args:
        nodes: command of each node.
        folder: folder for ROS's logs and the nodes' output, `<node>.log`.

    Yields:
        The nodes' processes. Inside the block, the environment of this process names the master.

    Raises:
        InputError: ROS 1 is not installed, or the master did not start.
    """
    require_ros()
    folder.mkdir(parents=True, exist_ok=True)
    with socket.socket() as free:
        free.bind((HOST, 0))
        port = free.getsockname()[1]
    settings = {
        "ROS_MASTER_URI": f"http://{HOST}:{port}",
        "ROS_IP": HOST,
        "ROS_HOME": str(folder.resolve() / "ros_home"),
        "ROS_LOG_DIR": str(folder.resolve() / "ros_log"),
    }
    before = {name: os.environ.get(name) for name in settings}
    os.environ.update(settings)
    processes: dict[str, subprocess.Popen[bytes]] = {}
    try:
        master = _start([str(ROSMASTER), "--core", "-p", str(port)], folder / "rosmaster.log")
        processes["rosmaster"] = master
        _wait_for_master(settings["ROS_MASTER_URI"], master)
        set_clock(settings["ROS_MASTER_URI"])
        for name, command in nodes.items():
            processes[name] = _start(command, folder / f"{name}.log")
        yield {name: process for name, process in processes.items() if name != "rosmaster"}
    finally:
        for process in reversed(processes.values()):
            _stop(process)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def require_running(processes: Mapping[str, subprocess.Popen[bytes]], folder: Path) -> None:
    """Check that all nodes still run.

    Args:
        processes: result of `graph`.
        folder: the folder given to `graph`.

    Raises:
        InputError: a node has ended; the message holds its last line of output.
    """
    for name, process in processes.items():
        if process.poll() is None:
            continue
        log = folder / f"{name}.log"
        lines = log.read_text(errors="replace").split("\n")
        last = next((line.strip() for line in reversed(lines) if line.strip()), "it printed nothing")
        raise InputError(f"{name} ended before its time: {last} ({log})")


def _start(command: Sequence[str], log: Path) -> subprocess.Popen[bytes]:
    with log.open("wb") as stream:
        return subprocess.Popen(
            [*PARENT_DEATH_SIGNAL, *command],
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )


def _wait_for_master(uri: str, master: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline and master.poll() is None:
        with contextlib.suppress(OSError, xmlrpc.client.Error):
            xmlrpc.client.ServerProxy(uri).getPid(CALLER)
            return
        time.sleep(POLL_S)
    raise InputError(f"no ROS master came up at {uri}; see rosmaster.log")


def _stop(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGINT)
        try:
            process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()
