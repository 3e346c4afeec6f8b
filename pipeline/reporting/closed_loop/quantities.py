"""Formatting of a closed loop's numbers: in mrad or mm, with significant digits only."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

MISSING = "–"
STEP_S = 0.05  # contract, section 2: one row of tuples per 50 ms
# Errors and speeds of an arm read well in thousandths.
_READABLE = {"rad": (1e3, "mrad"), "m": (1e3, "mm"), "rad/s": (1e3, "mrad/s"), "m/s": (1e3, "mm/s")}
_WITHOUT_NAME = ("1", "sign")


def number(value: Any) -> float:
    """A number of a JSON document; NaN if it is `null`, missing or not a number."""
    return float(value) if isinstance(value, int | float) else math.nan


def readable_unit(unit: str) -> tuple[float, str]:
    """Factor and name of the displayed unit; the name is empty for plain numbers."""
    return _READABLE.get(unit, (1.0, "" if unit in _WITHOUT_NAME else unit))


def with_unit(text: str, unit: str) -> str:
    """`41` and `rad` to `41 mrad`; the number must already be in the displayed unit."""
    return " ".join((text, readable_unit(unit)[1])).strip()


def significant(value: float, digits: int = 3) -> str:
    """Format with significant digits, but whole numbers in full: 0.751, 41.2, 1234."""
    if not math.isfinite(value):
        return MISSING
    if value == 0:
        return "0"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return _fixed(value, decimals)


def percent(share: float) -> str:
    """A share as a whole percentage; below 1 %, with one decimal."""
    if not math.isfinite(share):
        return MISSING
    return f"{_fixed(100 * share, 0 if abs(share) >= 0.0095 or abs(share) < 0.0005 else 1)} %"


def probability(p_value: float) -> str:
    """`p = 0.003`, `p = 1e-6`."""
    mantissa = (
        significant(p_value, 1) if p_value >= 1e-3 or p_value == 0 else f"{p_value:.0e}".replace("e-0", "e-")
    )
    return f"p = {mantissa}"


def estimate(parameter: Mapping[str, Any]) -> tuple[str, tuple[str, str] | None, str]:
    """Value, 95 % interval and unit's name of a parameter of `closed_loop.json`.

    The interval's width sets the number of digits; without an interval there are three.
    """
    factor, unit = readable_unit(str(parameter.get("unit", "1")))
    value = factor * number(parameter.get("value"))
    bounds = parameter.get("ci95")
    if not isinstance(bounds, Sequence) or len(bounds) != 2:
        return _plain(value), None, unit
    low, high = (factor * number(bound) for bound in bounds)
    if not (math.isfinite(low) and math.isfinite(high)):
        return _plain(value), None, unit
    if high <= low:
        return significant(value), (significant(low), significant(high)), unit
    decimals = max(0, math.ceil(-math.log10((high - low) / 2)))
    return _fixed(value, decimals), (_fixed(low, decimals), _fixed(high, decimals)), unit


def _plain(value: float) -> str:
    """Three significant digits without trailing zeros."""
    text = significant(value)
    return text.rstrip("0").rstrip(".") if "." in text else text


def _fixed(value: float, decimals: int) -> str:
    if not math.isfinite(value):
        return MISSING
    text = f"{value:.{decimals}f}"
    return text.removeprefix("-") if float(text) == 0 else text.replace("-", "−")
