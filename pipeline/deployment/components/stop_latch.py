"""What every acting component keeps of stops."""

from pipeline.deployment.component import Condition
from pipeline.deployment.messages import EmergencyStop, Level, Message, Release


class StopLatch:
    """Closes at an emergency stop; opens at the release of that stop or of a later one.

    Attributes:
        stop_ns: stamp of the latest stop that is not released; None while open.
        last: the latest stop that was heard, in force or released.
        closings: how often it has closed, so that what was asked for before a stop is recognised after it.
    """

    def __init__(self) -> None:
        self.stop_ns: int | None = None
        self.last: EmergencyStop | None = None
        self.closings = 0

    @property
    def is_closed(self) -> bool:
        """Whether a stop is in force."""
        return self.stop_ns is not None

    def hear(self, message: Message) -> None:
        """Take account of a stop or a release; ignore other messages."""
        if isinstance(message, EmergencyStop):
            if self.stop_ns is None or message.stamp_ns > self.stop_ns:
                self.closings += 1
                self.stop_ns, self.last = message.stamp_ns, message
        elif isinstance(message, Release) and self.stop_ns is not None and message.stop_ns >= self.stop_ns:
            self.stop_ns = None

    def condition(self, otherwise: Condition) -> Condition:
        """An error while a stop is in force, `otherwise` without one; both name the last stop."""
        reason = f"{self.last.rule}: {self.last.detail}" if self.last else "none"
        values = {**otherwise.values, "last stop": reason}
        if self.is_closed:
            return Condition(Level.error, f"stopped by {reason}", values)
        return otherwise._replace(values=values)
