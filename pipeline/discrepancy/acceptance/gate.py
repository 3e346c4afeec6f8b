"""The gate: what an effect has to pass before it is reported."""

from dataclasses import dataclass

from pipeline.errors import InputError


@dataclass
class GateConfig:
    """Thresholds of the gate.

    Attributes:
        smallest_e_value: On confirmation rows, against the effect's not being there.
        smallest_error_reduction: Of the open-loop error over 80 steps on its joints, for an effect to be named.
        smallest_share: Of the squared residual, instead, for the strongest effect: one that hardly moves positions.
        worse_margin: Relative rise of a joint's open-loop error that still counts as none, as does one that
            blocks do not bear out.
        confidence: With which blocks bear it out, one-sided.
        model_error: Share of a parameter by which the idealised effect may differ from the real one; widens intervals.
        smallest_excitation_s: Time in motion that a joint has to have in the logs for a verdict on it.
    """

    smallest_e_value: float
    smallest_error_reduction: float
    smallest_share: float
    worse_margin: float
    confidence: float
    model_error: float
    smallest_excitation_s: float

    def __post_init__(self) -> None:
        if not 0 < self.confidence < 1:
            raise InputError(f"close_loop.gate.confidence is {self.confidence}; it must be in (0, 1)")
        if not self.smallest_e_value > 1:
            raise InputError(
                f"close_loop.gate.smallest_e_value is {self.smallest_e_value}; it must be above 1"
            )
        if not self.model_error >= 0:
            raise InputError(f"close_loop.gate.model_error is {self.model_error}; it must not be negative")
