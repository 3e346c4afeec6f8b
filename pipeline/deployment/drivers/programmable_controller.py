"""A simulated PLC of the machine, on a CAN bus: holds its set-points, and zeroes them when in doubt.

According to the paper, the real one maps discrete commands to current set-points of the electro-valves. Its stop is
assumed, as usual for machine controllers: it zeroes its outputs on an emergency frame until a release frame, and
without command frames.
"""

from collections.abc import Sequence

import can
import numpy as np

from pipeline.deployment.component import Component, Condition, Output, nanoseconds
from pipeline.deployment.drivers.can_frames import CanFrames
from pipeline.deployment.drivers.emcb_200u_driver import read_frames
from pipeline.deployment.drivers.machine import Machine
from pipeline.deployment.messages import CanFrame, Level
from pipeline.deployment.settings import DriverConfig


class ProgrammableController(Component):
    """Cycles at the CAN period; drives a machine whose period is a whole number of its cycles."""

    name = "plc"

    def __init__(
        self, bus: can.BusABC, frames: CanFrames, machine: Machine, n_joint: int, config: DriverConfig
    ) -> None:
        self.period_ns = nanoseconds(config.can_period_s)
        self._bus = bus
        self._frames = frames
        self._machine = machine
        self._cycles_per_period = max(round(machine.period_ns / self.period_ns), 1)
        self._timeout_ns = nanoseconds(config.command_timeout_s)
        self.output = np.zeros(n_joint)
        self._is_stopped = False
        self._received_ns = 0
        self._n_cycle = 0

    def on_timer(self, now_ns: int) -> Sequence[Output]:
        """One cycle: read frames, set outputs, move the machine, send encoder frames."""
        for frame in read_frames(self._bus, now_ns):
            command = self._frames.read_command(frame)
            if self._frames.is_emergency(frame):
                self._is_stopped = True
            elif self._frames.is_release(frame):
                self._is_stopped, self.output = False, np.zeros_like(self.output)
            elif command is not None:
                self.output, self._received_ns = command, now_ns
        if self._is_stopped or now_ns - self._received_ns > self._timeout_ns:
            self.output = np.zeros_like(self.output)
        if self._n_cycle % self._cycles_per_period == 0:
            samples = self._machine.read() if self._n_cycle == 0 else self._machine.advance(self.output)
            for sample in samples:
                self._send(self._frames.encoders(sample.position, now_ns))
        self._n_cycle += 1
        return ()

    def condition(self, now_ns: int) -> Condition:
        """Its outputs, and why they are zero."""
        values = {"outputs": str(self.output.tolist())}
        if self._is_stopped:
            return Condition(Level.error, "stopped by an emergency frame", values)
        return Condition(Level.ok, "follows command frames", values)

    def _send(self, frame: CanFrame) -> None:
        message = can.Message(arbitration_id=frame.identifier, data=frame.data, is_extended_id=False)
        try:
            self._bus.send(message)
        except can.CanOperationError:
            return  # bus off: the frame is lost
