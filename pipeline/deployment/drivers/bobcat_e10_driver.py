"""`bobcat_e10_driver`: converts between the graph's messages and the machine's CAN frames (paper, appendix)."""

from collections.abc import Sequence

from pipeline.deployment.component import Component, Condition, Output, Publication
from pipeline.deployment.components.commands import is_command
from pipeline.deployment.components.stop_latch import StopLatch
from pipeline.deployment.components.velocity_estimator import VelocityEstimator
from pipeline.deployment.drivers.can_frames import CanFrames
from pipeline.deployment.messages import (
    CanFrame,
    EmergencyStop,
    JointState,
    Level,
    MachineCommand,
    Message,
    Release,
    Topic,
)
from pipeline.machine.specification import MachineSpecification


class MachineDriver(Component):
    """Commands become frames; encoder frames become joint states with velocities of the loop tracker.

    An emergency stop becomes the emergency frame, and no command frame is sent until its release, which becomes the
    release frame if the machine's DBC file defines one.
    """

    name = "bobcat_e10_driver"
    subscriptions = (Topic.joint_commands, Topic.emergency_stop, Topic.release, Topic.can_from_machine)

    def __init__(
        self, machine: MachineSpecification, frames: CanFrames, estimator: VelocityEstimator
    ) -> None:
        self._machine = machine
        self._frames = frames
        self._estimator = estimator
        self._counter = 0
        self._latch = StopLatch()

    def on_message(self, topic: Topic, message: Message, now_ns: int) -> Sequence[Output]:
        """Translate."""
        if isinstance(message, MachineCommand):
            if self._latch.is_closed or not is_command(self._machine, message.values):
                return ()  # the machine's controller zeroes its outputs without frames
            self._counter += 1
            frame = self._frames.command(message.values, self._counter, now_ns)
            return (Publication(Topic.can_to_machine, frame),)
        if isinstance(message, EmergencyStop):
            self._latch.hear(message)
            emergency = Publication(Topic.can_to_machine, self._frames.emergency(now_ns))
            return (emergency,) if self._latch.is_closed else ()
        if isinstance(message, Release):
            self._latch.hear(message)
            frame_of_release = None if self._latch.is_closed else self._frames.release(now_ns)
            return (Publication(Topic.can_to_machine, frame_of_release),) if frame_of_release else ()
        if isinstance(message, CanFrame):
            position = self._frames.read_encoders(message)
            if position is not None:
                velocity = self._estimator.update(message.stamp_ns, position)
                return (Publication(Topic.joint_states, JointState(message.stamp_ns, position, velocity)),)
        return ()

    def condition(self, now_ns: int) -> Condition:
        """Whether commands become frames."""
        return self._latch.condition(Condition(Level.ok, "translates"))
