"""What holds of every number in a configuration, whatever it is for. Other ranges stand with the settings."""

import math
from typing import Any

from pipeline.errors import InputError

SEED, SEEDS = "seed", "seeds"


def check_numbers(settings: Any, place: str = "") -> None:
    """Raise `InputError` if a number is not finite, which passes many comparisons, or a seed is negative.

    Args:
        settings: A configuration as nested dicts and lists.
        place: Of it in the whole, for the message.
    """
    if isinstance(settings, dict):
        for key, value in settings.items():
            check_numbers(value, f"{place}.{key}" if place else str(key))
    elif isinstance(settings, list):
        for value in settings:
            check_numbers(value, place)
    elif isinstance(settings, float) and not math.isfinite(settings):
        raise InputError(f"{place} is {settings}; it must be a finite number")
    elif isinstance(settings, int) and settings < 0 and _is_seed(place.rpartition(".")[2]):
        raise InputError(f"{place} is {settings}; it must not be negative")


def _is_seed(name: str) -> bool:
    return name in (SEED, SEEDS) or name.endswith((f"_{SEED}", f"_{SEEDS}"))
