"""Section `ingest` of a profile."""

from dataclasses import dataclass

from pipeline.errors import InputError


@dataclass
class IngestConfig:
    """How logs become tuples.

    Attributes:
        validation_fraction: Last share of each trajectory that is for validation.
        maximum_gap_s: Longer gaps between joint samples split a trajectory.
        minimum_trajectory_s: Shorter stretches are left out, and counted.
        maximum_clock_offset_s: Header stamps further than this from log time are of a foreign clock; log time is used.
        maximum_speed_ranges_per_s: No joint is faster, in joint ranges per second; more is an encoder's fault.
        maximum_invalid_command_fraction: A log with a larger share of impossible commands is refused.
        frozen_after_s: An encoder that repeats its value for longer, while its joint is commanded, is reported.
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
