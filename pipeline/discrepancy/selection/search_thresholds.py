"""Section `close_loop.search` of a profile."""

from dataclasses import dataclass

from pipeline.errors import InputError


@dataclass
class EffectSearchConfig:
    """Thresholds of the search.

    Attributes:
        smallest_share: Of the squared residual; an effect that removes less is not looked for.
        smallest_gain: The same in units of the noise floor's squares.
        second_share: A further effect on a joint has to gain this share of what the first gained there.
        null_factor: How many times its gain per row of nominal logs a candidate owes at most to the model's misfit.
        smallest_t: Of the gain over its standard error by blocks.
        second_t: The same of further effects, which may be what the first leaves over.
        equivalent_t: A candidate is worse than the best only if the difference is so many standard errors.
        maximum_effects: The search ends when it has found so many.
        block_s: Length of a block of the bootstrap, longer than the residual's correlation.
        nominal_rows: Of nominal logs, at most, on which the same search is run for comparison.
    """

    smallest_share: float
    smallest_gain: float
    second_share: float
    null_factor: float
    smallest_t: float
    second_t: float
    equivalent_t: float
    maximum_effects: int
    block_s: float
    nominal_rows: int

    def __post_init__(self) -> None:
        if not 0 < self.smallest_share < 1:
            raise InputError(
                f"close_loop.search.smallest_share is {self.smallest_share}; it must be in (0, 1)"
            )
        if self.maximum_effects < 1:
            raise InputError("close_loop.search.maximum_effects must be at least 1")

    def block_rows(self, dt_s: float) -> int:
        """Rows of a block of the bootstrap."""
        return max(1, round(self.block_s / dt_s))
