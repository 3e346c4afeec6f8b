"""The helper that runs ROS graphs leaves nothing behind, and says what is missing."""

import time
from pathlib import Path

import pytest

from tests.ros_graph import DEBIAN_PYTHON, RosGraph, RosGraphError, requires_debian

STUBBORN = """
import os, signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGTERM, signal.SIG_IGN)
child = os.fork()
if child:
    print(os.getpid(), child, flush=True)
time.sleep(1000)
"""


def runs(process_number: int) -> bool:
    try:
        status = Path(f"/proc/{process_number}/stat").read_text()
    except OSError:
        return False
    return status.rpartition(")")[2].split()[0] not in "ZX"


def test_missing_packages_are_named():
    mark = requires_debian({"present": Path("/"), "python3-absent": Path("/no/such/file")})
    assert mark.args == (True,)
    assert "apt-get install --no-install-recommends python3-absent" in mark.kwargs["reason"]


@requires_debian()
def test_nothing_is_left(tmp_path):
    with RosGraph(tmp_path) as graph:
        node = graph.start("stubborn", [DEBIAN_PYTHON, "-c", STUBBORN])
        graph.wait_until(lambda: len(node.output.read_text().split()) == 2, "process numbers")
        numbers = [int(word) for word in node.output.read_text().split()]
        with pytest.raises(RosGraphError, match=r"no 1 publishers of /nothing(.|\n)*stubborn \(runs\)"):
            graph.wait_for_publishers("/nothing", timeout_s=0.1)
        assert all(runs(number) for number in numbers)
        assert graph.stop(node, timeout_s=0.1) == [-9]
        second = graph.start("second", ["sleep", "1000"])
        master = graph.nodes[0]
    for _ in range(100):
        left = [n for n in (*numbers, second.process.pid, master.process.pid) if runs(n)]
        if not left:
            break
        time.sleep(0.02)
    assert left == []
    assert master.process.returncode == 0  # it ended by itself
