"""Section `ingest` of a profile."""

from dataclasses import dataclass

from pipeline.errors import InputError


@dataclass
class IngestConfig:
    """Settings of the conversion from logs to tuples.

    Attributes:
        validation_fraction: Share at each trajectory's end that is for validation.
        maximum_gap_s: Longer gaps between joint samples split a trajectory.
        minimum_trajectory_s: Shorter stretches are dropped, and counted.
        maximum_clock_offset_s: Header stamps further from log time come from another clock; log time is used.
        maximum_speed_ranges_per_s: Highest speed, in joint ranges per second; more is an encoder fault.
        maximum_invalid_command_fraction: A log with a larger share of invalid commands is refused.
        frozen_after_s: An encoder is reported if it repeats its value for longer under command.
    """

    validation_fraction: float
    maximum_gap_s: float
    minimum_trajectory_s: float
    maximum_clock_offset_s: float
    maximum_speed_ranges_per_s: float
    maximum_invalid_command_fraction: float
    frozen_after_s: float

    def __post_init__(self) -> None:
        for name in ("validation_fraction", "maximum_invalid_command_fraction"):
            if not 0 <= getattr(self, name) < 1:
                raise InputError(f"ingest.{name} is {getattr(self, name)}; it must be at least 0 and below 1")
        for name in (
            "maximum_gap_s",
            "maximum_clock_offset_s",
            "maximum_speed_ranges_per_s",
            "frozen_after_s",
        ):
            if not getattr(self, name) > 0:
                raise InputError(f"ingest.{name} is {getattr(self, name)}; it must be positive")
        if not self.minimum_trajectory_s >= 0:
            raise InputError(
                f"ingest.minimum_trajectory_s is {self.minimum_trajectory_s}; it must not be negative"
            )
