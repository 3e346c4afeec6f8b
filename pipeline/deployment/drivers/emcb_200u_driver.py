"""`emcb_200u_driver`: connects the graph to a CAN bus (paper, appendix; the EMCB-200U is a USB-CAN adapter)."""

from collections.abc import Sequence

import can

from pipeline.deployment.component import Component, Condition, Output, Publication, nanoseconds
from pipeline.deployment.messages import CanFrame, Level, Message, Topic
from pipeline.deployment.settings import DriverConfig


class CanDriver(Component):
    """Sends frames to the bus at once, and publishes the newest frame of each identifier at each tick.

    Frames that a late tick finds together would have one stamp, and one stamp twice is a joint state sent twice.

    A frame that the bus refuses (bus off) is counted and not retried: the machine's controller zeroes its outputs
    without frames, and the supervisor misses the joint states.
    """

    name = "emcb_200u_driver"
    subscriptions = (Topic.can_to_machine,)

    def __init__(self, bus: can.BusABC, config: DriverConfig) -> None:
        self.period_ns = nanoseconds(config.can_period_s)
        self._bus = bus
        self.n_refused = 0

    def on_message(self, topic: Topic, message: Message, now_ns: int) -> Sequence[Output]:
        """Send a frame."""
        if isinstance(message, CanFrame):
            frame = can.Message(
                arbitration_id=message.identifier, data=message.data, is_extended_id=False, check=True
            )
            try:
                self._bus.send(frame)
            except can.CanOperationError:
                self.n_refused += 1
        return ()

    def on_timer(self, now_ns: int) -> Sequence[Output]:
        """Publish what came since the last tick, stamped with this one."""
        newest = {frame.identifier: frame for frame in read_frames(self._bus, now_ns)}
        return [Publication(Topic.can_from_machine, frame) for frame in newest.values()]

    def condition(self, now_ns: int) -> Condition:
        """Whether the bus has refused frames."""
        values = {"frames refused": str(self.n_refused)}
        if self.n_refused:
            return Condition(Level.error, "the bus refuses frames", values)
        return Condition(Level.ok, "the bus takes frames", values)


def read_frames(bus: can.BusABC, now_ns: int) -> list[CanFrame]:
    """All waiting data frames of a bus, stamped `now_ns`; error and remote frames are dropped."""
    frames = []
    try:
        while (message := bus.recv(timeout=0.0)) is not None:
            if not (message.is_error_frame or message.is_remote_frame):
                frames.append(CanFrame(now_ns, message.arbitration_id, bytes(message.data)))
    except can.CanOperationError:
        return frames  # bus off: earlier frames still count
    return frames
