"""Whatever of the ROS graph is killed, at any phase: the machine stands within one time-out, and the log can be read.

The machine is here, a PLC at the other end of the CAN bus, by whose clock and outputs everything is measured.
"""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.deployment.drivers.can_frames import CanFrames
from pipeline.deployment.drivers.programmable_controller import ProgrammableController
from pipeline.deployment.graph_logs.graph_topics import read_graph_topics
from pipeline.deployment.transports.ros1.can_bus import open_bus
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.messages.columns import as_array
from tests.deployment.fault_triples import PLC_STOPS_S
from tests.deployment.machines import Integrator, bobcat, supervised
from tests.deployment.ros_kills import BAG, KILLED, OPERATOR, PIDS
from tests.deployment.ros_node import ALL_RULES, OF_TIME, SUPERVISED, bus_config
from tests.deployment.ros_trial import START_S, carries_frames
from tests.deployment.test_ros_trial import PACKAGES
from tests.ros_graph import requires_debian

pytestmark = [pytest.mark.long, requires_debian(PACKAGES)]
ROOT = Path(__file__).parents[2]
LATEST_PHASE_S = 0.4  # two decisions
WATCHED_S = 1.0
MOVING_S = 0.3  # for so long before a kill
DRIVEN_S = 60.0
LATE_S = supervised().supervisor.maximum_command_delay_s


class Machine:
    """The PLC in a thread of its own: `cycles` holds when each began, s, and whether its outputs moved a joint."""

    def __init__(self, port: int) -> None:
        machine, config = bobcat(), supervised().driver
        frames = CanFrames(machine, MACHINE_DIRECTORY)
        self._bus = open_bus(bus_config(port))
        self._plc = ProgrammableController(self._bus, frames, Integrator(), machine.n_joint, config)
        self._has_ended = threading.Event()
        self.cycles: list[tuple[float, bool]] = []
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> "Machine":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._has_ended.set()
        self._thread.join()
        self._bus.shutdown()

    def _run(self) -> None:
        due_s = time.monotonic()
        while not self._has_ended.is_set():
            now_s = time.monotonic()
            self._plc.on_timer(round(1e9 * now_s))
            self.cycles.append((now_s, bool(self._plc.output.any())))
            due_s = max(due_s + 1e-9 * self._plc.period_ns, now_s)
            time.sleep(max(due_s - time.monotonic(), 0.0))

    def wait_for_motion(self, timeout_s: float = START_S) -> None:
        """Until the outputs have moved a joint for a while."""
        deadline = time.monotonic() + timeout_s
        while True:
            recent = [moves for at_s, moves in self.cycles[-100:] if at_s > time.monotonic() - MOVING_S]
            if len(recent) > 1 and all(recent):
                return
            assert time.monotonic() < deadline, "the machine does not move"
            time.sleep(0.01)

    def standstill_s(self, since_s: float) -> tuple[float, float]:
        """From then to the first cycle without outputs, and the longest cycle until a while later; s."""
        time.sleep(WATCHED_S)
        after = [(at_s, moves) for at_s, moves in self.cycles if at_s > since_s - 0.05]
        stopped_s = next((at_s for at_s, moves in after if at_s > since_s and not moves), np.inf)
        return stopped_s - since_s, float(np.diff([at_s for at_s, _ in after]).max())


class Killing:
    """A machine, and a graph in another process that drives it."""

    def __init__(self, folder: Path, rules: str = SUPERVISED) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("", 0))
            port = free.getsockname()[1]
        if not carries_frames(bus_config(port)):
            pytest.skip("no multicast between processes here, so no CAN bus")
        self.folder, self.machine = folder, Machine(port)
        command = [sys.executable, "-m", "tests.deployment.ros_kills", str(folder), str(port), rules]
        with (folder / "operator.log").open("wb") as log:
            self.operator = subprocess.Popen(command, cwd=ROOT, stdout=log, stderr=log)

    def __enter__(self) -> "Killing":
        self.machine.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self.operator.kill()
        self.operator.wait()
        self.machine.__exit__()

    def pids(self) -> dict[str, int]:
        return json.loads((self.folder / PIDS).read_text())

    def kill(self, names: Sequence[str], phase_s: float) -> float:
        """Kill processes while the machine moves; how long it moves on, less this computer's lateness, s."""
        while True:
            self.machine.wait_for_motion()
            time.sleep(phase_s)
            pids = self.pids()
            if self.machine.cycles[-1][1]:
                break  # else it was stopped, or a goal ended
        since_s = time.monotonic()
        for name in names:
            os.kill(pids[name], signal.SIGKILL)
        stopped_s, late_s = self.machine.standstill_s(since_s)
        print(
            f"killed {names} after {phase_s:.3f} s: stood after {stopped_s:.3f} s, cycles to {late_s:.3f} s"
        )
        return stopped_s - late_s

    def recorded(self) -> tuple[int, set[str]]:
        """Of what the operator has recorded so far: the number of joint states, and the rules that stopped it."""
        (entry,) = find_logs((self.folder / BAG).parent)
        n_states = len(as_array(read_log(entry, bobcat()).q))
        return n_states, {stop.rule for _, stop in read_graph_topics(entry).stops}


@pytest.mark.parametrize(
    "names", [*((name,) for name in KILLED), (OPERATOR,), (*KILLED, OPERATOR)], ids=" ".join
)
def test_the_machine_stands_within_a_time_out_of_a_death(tmp_path: Path, names: tuple[str, ...]) -> None:
    phase_s = np.random.default_rng([*"".join(names).encode()]).uniform(0.0, LATEST_PHASE_S)
    with Killing(tmp_path) as killing:
        assert killing.kill(names, phase_s) <= PLC_STOPS_S
        assert killing.recorded()[0] * supervised().driver.can_period_s > MOVING_S


def test_no_rule_objects_to_a_minute_of_sound_driving(tmp_path: Path) -> None:
    with Killing(tmp_path, ALL_RULES) as killing:
        killing.machine.wait_for_motion()
        time.sleep(DRIVEN_S)
        late_s = np.diff([at_s for at_s, _ in killing.machine.cycles]).max()
        states, rules = killing.recorded()
    assert states * bobcat().dt_s > DRIVEN_S / 2
    print(f"cycles to {late_s:.3f} s, stopped by {sorted(rules) or 'nobody'}")
    # rules of time stop with reason where this computer is late
    assert rules <= (set(OF_TIME) if late_s > LATE_S else set())
