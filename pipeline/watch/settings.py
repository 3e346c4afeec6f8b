"""Section `watch` of a profile."""

from dataclasses import dataclass

from pipeline.errors import InputError


@dataclass
class WatchConfig:
    """How a machine is watched.

    Attributes:
        false_alarms: Probability that a machine that never changes is ever told as changed, over all joints and days.
        least_nominal: Sessions that the null is learned from.
        cause_minutes: Of the latest sessions since a change, on which its cause is sought.
        live_every_s: Of motion, from one judgement of the running session to the next at least.
    """

    false_alarms: float
    least_nominal: int
    cause_minutes: float
    live_every_s: float

    def __post_init__(self) -> None:
        if not 0.0 < self.false_alarms < 1.0:
            raise InputError(f"watch.false_alarms is {self.false_alarms}; it must lie between 0 and 1")
        if self.least_nominal < 5:
            raise InputError(f"watch.least_nominal is {self.least_nominal}; it must be at least 5")
        for name in ("cause_minutes", "live_every_s"):
            if getattr(self, name) <= 0.0:
                raise InputError(f"watch.{name} is {getattr(self, name)}; it must be positive")
