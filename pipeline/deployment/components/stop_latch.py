"""What every acting component keeps of stops."""

from pipeline.deployment.component import Condition
from pipeline.deployment.messages import EmergencyStop, Level, Message, Release


class StopLatch:
    """Closes at an emergency stop; opens at the release of that stop or of a later one.

    Topics keep no order among each other: a stop that comes after its release stays released.

    Attributes:
        last: the latest stop that was heard, in force or released.
        closings: how often it has closed, so that what was asked for before a stop is recognised after it.
    """

    def __init__(self) -> None:
        self.last: EmergencyStop | None = None
        self.closings = 0
        self._released_ns = -1

    @property
    def is_closed(self) -> bool:
        """Whether a stop is in force."""
        return self.last is not None and self.last.stamp_ns > self._released_ns

    def hear(self, message: Message) -> None:
        """Take account of a stop or a release; ignore other messages."""
        if isinstance(message, EmergencyStop):
            if self.last is None or message.stamp_ns > self.last.stamp_ns:
                self.closings += 1
                self.last = message
        elif isinstance(message, Release):
            self._released_ns = max(self._released_ns, message.stop_ns)

    def later_than_known(self, now_ns: int) -> int:
        """The stamp of a stop that begins now, though the clock is behind those of former stops and their releases."""
        known_ns = -1 if self.last is None else self.last.stamp_ns
        return max(now_ns, known_ns + 1, self._released_ns + 1)

    def condition(self, otherwise: Condition) -> Condition:
        """An error while a stop is in force, `otherwise` without one; both name the last stop."""
        reason = f"{self.last.rule}: {self.last.detail}" if self.last else "none"
        values = {**otherwise.values, "last stop": reason}
        if self.is_closed:
            return Condition(Level.error, f"stopped by {reason}", values)
        return otherwise._replace(values=values)
