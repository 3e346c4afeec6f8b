"""Section `close_loop.posterior` of a profile."""

from dataclasses import dataclass

from pipeline.errors import InputError


@dataclass
class PosteriorConfig:
    """When an effect is told.

    Attributes:
        largest_none: Probability of no effect up to which one is told: the false alarms that are allowed.
    """

    largest_none: float

    def __post_init__(self) -> None:
        if not 0.0 < self.largest_none < 1.0:
            raise InputError(
                f"close_loop.posterior.largest_none is {self.largest_none}; it must be in (0, 1)"
            )
