"""The simulated PLC between frames and its machine."""

from collections.abc import Iterator

import can
import numpy as np
import pytest

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.deployment.drivers.can_frames import CanFrames
from pipeline.deployment.drivers.emcb_200u_driver import CanDriver
from pipeline.deployment.drivers.machine import Sample
from pipeline.deployment.drivers.programmable_controller import ProgrammableController
from pipeline.deployment.messages import CanFrame, Level
from tests.deployment.machines import MIDDLE, bobcat, paper

DRIVER = paper().driver
FRAMES = CanFrames(bobcat(), MACHINE_DIRECTORY)
CYCLES_PER_PERIOD = 4
COMMAND = np.array([1.0, 0.0, -1.0, 0.0])
RESOLUTION = np.pi / 65536


class Counted:
    """A machine whose first joint has turned by a hundredth per period; it keeps its commands."""

    def __init__(self, cycle_ns: int) -> None:
        self.period_ns = CYCLES_PER_PERIOD * cycle_ns
        self.commands: list[np.ndarray] = []

    def read(self) -> list[Sample]:
        return [Sample(0, MIDDLE + np.array([0.01 * len(self.commands), 0, 0, 0]), None)]

    def advance(self, command: np.ndarray) -> list[Sample]:
        self.commands.append(command.copy())
        return self.read()


@pytest.fixture
def bus() -> Iterator[tuple[can.BusABC, can.BusABC]]:
    """This computer's end and the PLC's."""
    with can.Bus("one plc", interface="virtual") as host, can.Bus("one plc", interface="virtual") as far:
        yield host, far


def send(bus: can.BusABC, *frames: CanFrame) -> None:
    for frame in frames:
        bus.send(can.Message(arbitration_id=frame.identifier, data=frame.data, is_extended_id=False))


def readings(bus: can.BusABC) -> list[float]:
    """The first joint in every encoder frame that waits."""
    found = []
    while (message := bus.recv(timeout=0.0)) is not None:
        assert not message.is_extended_id
        q = FRAMES.read_encoders(CanFrame(0, message.arbitration_id, bytes(message.data)))
        assert q is not None
        found.append(float(q[0]))
    return found


def test_the_machine_moves_once_a_period_by_the_newest_command_and_is_read(
    bus: tuple[can.BusABC, can.BusABC],
) -> None:
    host, far = bus
    cycle_ns = round(1e9 * DRIVER.can_period_s)
    machine = Counted(cycle_ns)
    plc = ProgrammableController(far, FRAMES, machine, 4, DRIVER)
    assert plc.period_ns == cycle_ns
    n_readings = []
    for n in range(3 * CYCLES_PER_PERIOD + 1):
        send(host, FRAMES.command(0 * COMMAND, 2 * n, 0), FRAMES.command(COMMAND, 2 * n + 1, 0))
        plc.on_timer(n * cycle_ns)
        n_readings.append(readings(host))
    moves = [number for number, found in enumerate(n_readings) if found]
    assert moves == [0, 4, 8, 12]  # the first one is read as it stands
    np.testing.assert_array_equal(machine.commands, [COMMAND] * 3)
    first = [found[0] for found in n_readings if found]
    np.testing.assert_allclose(first, [0.0, 0.01, 0.02, 0.03], atol=RESOLUTION)


def test_a_machine_faster_than_a_cycle_moves_at_each(bus: tuple[can.BusABC, can.BusABC]) -> None:
    machine = Counted(1)
    plc = ProgrammableController(bus[1], FRAMES, machine, 4, DRIVER)
    for n in range(5):
        plc.on_timer(n * plc.period_ns)
    np.testing.assert_array_equal(machine.commands, np.zeros((4, 4)))  # without frames it stands


def test_outputs_at_rest_are_those_of_all_joints(bus: tuple[can.BusABC, can.BusABC]) -> None:
    host, far = bus
    machine = Counted(1)
    plc = ProgrammableController(far, FRAMES, machine, 4, DRIVER)
    for n, frame in enumerate((FRAMES.command(COMMAND, 1, 0), FRAMES.emergency(0), FRAMES.release(0))):
        assert frame is not None
        send(host, frame)
        plc.on_timer(n * plc.period_ns)
    assert plc.condition(0)[:2] == (Level.ok, "follows command frames")
    np.testing.assert_array_equal(machine.commands, np.zeros((2, 4)))


def test_frames_that_a_late_tick_finds_together_are_one_reading(bus: tuple[can.BusABC, can.BusABC]) -> None:
    host, far = bus
    other = FRAMES.emergency(0)
    send(far, FRAMES.encoders(MIDDLE, 0), other, FRAMES.encoders(MIDDLE + 0.01, 0))
    told = [output.message for output in CanDriver(host, DRIVER).on_timer(5)]
    assert [(frame.identifier, frame.stamp_ns) for frame in told] == [
        (FRAMES.encoders(MIDDLE, 0).identifier, 5),
        (other.identifier, 5),
    ]
    np.testing.assert_allclose(FRAMES.read_encoders(told[0]), MIDDLE + 0.01, atol=RESOLUTION)


def test_a_command_is_in_force_until_its_time_out_is_over(bus: tuple[can.BusABC, can.BusABC]) -> None:
    host, far = bus
    plc, hour_ns = ProgrammableController(far, FRAMES, Counted(1), 4, DRIVER), round(3600e9)
    timeout_ns = round(1e9 * DRIVER.command_timeout_s)
    send(host, FRAMES.command(COMMAND, 0, 0))
    for now_ns in (hour_ns, hour_ns + timeout_ns):
        plc.on_timer(now_ns)
        values = {"outputs": str(COMMAND.tolist())}
        assert plc.condition(now_ns) == (Level.ok, "follows command frames", values)
    plc.on_timer(hour_ns + timeout_ns + 1)
    zero = {"outputs": str((0 * np.abs(COMMAND)).tolist())}
    assert plc.condition(hour_ns) == (Level.ok, "follows command frames", zero)
    send(host, FRAMES.emergency(0))
    plc.on_timer(2 * hour_ns)
    assert plc.condition(2 * hour_ns) == (Level.error, "stopped by an emergency frame", zero)
