"""What the logs of a closed loop would have shown, as a table."""

import math
from collections.abc import Sequence

from pipeline.reporting.closed_loop.quantities import (
    MISSING,
    number,
    percent,
    readable_unit,
    significant,
    with_unit,
)
from pipeline.reporting.closed_loop.words import Document, family_name


def visible_sizes(document: Document, joints: Sequence[str]) -> list[tuple[str, list[str]]]:
    """Per family the smallest size on each joint that would have been found with 90 %."""
    by_family: dict[str, dict[str, str]] = {}
    for of in document.get("power") or []:
        by_family.setdefault(of["family"], {})[of["joint"]] = _told(number(of["size"]), of["unit"])
    return [
        (family_name(family), [sizes.get(joint, MISSING) for joint in joints])
        for family, sizes in by_family.items()
    ]


def _told(size: float, unit: str) -> str:
    if unit == "1" or not math.isfinite(size):
        return percent(size)
    return with_unit(significant(readable_unit(unit)[0] * size, 2), unit)
