"""What every acting component keeps of stops."""

from pipeline.deployment.messages import EmergencyStop, Message, Release


class StopLatch:
    """Closes at an emergency stop; opens at the release of that stop or of a later one.

    Attributes:
        stop_ns: stamp of the latest stop that is not released; None while open.
        closings: how often it has closed, so that what was asked for before a stop is recognised after it.
    """

    def __init__(self) -> None:
        self.stop_ns: int | None = None
        self.closings = 0

    @property
    def is_closed(self) -> bool:
        """Whether a stop is in force."""
        return self.stop_ns is not None

    def close(self, stop_ns: int) -> None:
        """Close for the stop with this stamp."""
        if self.stop_ns is None or stop_ns > self.stop_ns:
            self.closings += 1
            self.stop_ns = stop_ns

    def hear(self, message: Message) -> None:
        """Take account of a stop or a release; ignore other messages."""
        if isinstance(message, EmergencyStop):
            self.close(message.stamp_ns)
        elif isinstance(message, Release) and self.stop_ns is not None and message.stop_ns >= self.stop_ns:
            self.stop_ns = None
