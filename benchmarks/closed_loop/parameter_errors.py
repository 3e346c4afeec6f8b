"""Reported parameters against true ones."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

NAMES = {
    "gain": ("speed_ratio", "direction"),
    "delay": ("added_delay",),
    "lag": ("added_time_constant",),
    "flow_coupling": ("loss_fraction",),
    "load": ("mean_speed_ratio_up", "mean_speed_ratio_down"),
    "thermal_drift": ("cold_speed_loss", "time_constant"),
    "supply_variation": ("std_log_speed", "correlation_time"),
    "leakage": ("sag_rate",),
    "backlash": ("width",),
    "stiction": ("mean_extra_time", "rest_threshold"),
    "end_cushion": ("zone_length", "min_speed_ratio", "side"),
    "sensor_bias": ("offset", "scale"),
    "timing": ("latency",),
    "oscillation": ("frequency", "damping_ratio"),
}
"""The contract's parameters of each family (section 4)."""

SIGNS = ("direction", "side")  # right or wrong; a relative error of zero for each would flatter the median

NEUTRAL = {
    "speed_ratio": 1.0,
    "mean_speed_ratio_up": 1.0,
    "mean_speed_ratio_down": 1.0,
    "min_speed_ratio": 1.0,
    "scale": 1.0,
}
"""Value that means no effect; 0 for all others."""

ABSOLUTE_SCALE = {"offset": 0.065, "scale": 0.07}
"""What an error is divided by where the true value is neutral: the middle of what the plant draws, rad and 1."""


@dataclass(frozen=True)
class ParameterError:
    """One reported number.

    Attributes:
        name: Of the contract.
        truth: Its true value.
        value: What was reported, None where it is missing.
        relative: |value - truth| / |truth|, or over `ABSOLUTE_SCALE` where the truth is neutral; None if missing.
        of_change: |value - truth| / |truth - neutral|: the stricter reading; None where the truth is neutral.
        covered: Whether the 95 % interval holds the truth; false where there is none.
    """

    name: str
    truth: float
    value: float | None
    relative: float | None
    of_change: float | None
    covered: bool


def numbers_of(family: str, truth: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Names of the family's numbers that the truth states, signs left out."""
    return [name for name in NAMES.get(family, ()) if name not in SIGNS and name in truth]


def parameter_errors(
    family: str, truth: Mapping[str, Mapping[str, Any]], reported: Mapping[str, Mapping[str, Any]]
) -> list[ParameterError]:
    """Errors of the family's numbers that the truth states, signs left out.

    What is neutral and was told to be so without an interval is not an estimate: of an encoder, that it is shifted
    and not scaled.
    """
    errors = []
    for name in numbers_of(family, truth):
        told = reported.get(name) or {}
        error = _error(name, float(truth[name]["value"]), told)
        is_neutral = error.of_change is None and error.relative == 0.0
        if not (is_neutral and _has_no_width(told.get("ci95"))):
            errors.append(error)
    return errors


def _has_no_width(interval: Sequence[float] | None) -> bool:
    return bool(interval) and interval[0] == interval[1]


def sign_is_right(
    family: str, truth: Mapping[str, Mapping[str, Any]], reported: Mapping[str, Mapping[str, Any]]
) -> bool | None:
    """Whether direction or side is right; None where the family has neither."""
    for name in SIGNS:
        if name in NAMES.get(family, ()) and name in truth:
            value = (reported.get(name) or {}).get("value")
            return value is not None and float(value) == float(truth[name]["value"])
    return None


def _error(name: str, truth: float, reported: Mapping[str, Any]) -> ParameterError:
    value = reported.get("value")
    if value is None:
        return ParameterError(name, truth, None, None, None, covered=False)
    lower, upper = reported.get("ci95") or (None, None)
    change = abs(truth - NEUTRAL.get(name, 0.0))
    scale = ABSOLUTE_SCALE.get(name, 1.0) if change == 0.0 else abs(truth)
    difference = abs(float(value) - truth)
    return ParameterError(
        name=name,
        truth=truth,
        value=float(value),
        relative=difference / scale,
        of_change=difference / change if change > 0.0 else None,
        covered=lower is not None and upper is not None and float(lower) <= truth <= float(upper),
    )
