"""What the logs of a closed loop would have shown, as a table."""

import math
from collections.abc import Sequence

from pipeline.reporting.closed_loop.quantities import MISSING, number, readable_unit, significant, with_unit
from pipeline.reporting.closed_loop.words import Document, family_name


def visible_sizes(document: Document, joints: Sequence[str]) -> list[tuple[str, list[str]]]:
    """Per family the smallest size on each joint that would have been found with 90 %."""
    by_family: dict[str, dict[str, str]] = {}
    for of in document.get("power") or []:
        factor, _ = readable_unit(of["unit"])
        size = factor * number(of["size"])
        told = with_unit(significant(size, 2), of["unit"]) if math.isfinite(size) else MISSING
        by_family.setdefault(of["family"], {})[of["joint"]] = told
    return [
        (family_name(family), [sizes.get(joint, MISSING) for joint in joints])
        for family, sizes in by_family.items()
    ]
