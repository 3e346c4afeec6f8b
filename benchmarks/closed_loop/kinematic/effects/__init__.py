"""Effects of the kinematic machine: one function per kind, which says how it acts, draws it and states its truth."""

import numpy as np

from benchmarks.closed_loop.kinematic.effects import of_commands, of_position, of_speed, outside
from benchmarks.closed_loop.kinematic.effects.effect import Effect, Kind, Quantity
from benchmarks.closed_loop.machines import Variant
from pipeline.errors import InputError

KINDS: dict[str, Kind] = of_commands.KINDS | of_speed.KINDS | of_position.KINDS | outside.KINDS
"""Every kind by name, with the physical bound of its size and what the strongest draw comes to there."""

OUTSIDE = tuple(outside.KINDS)
"""Those of family `other`."""

LARGEST_SIZE = {name: kind.largest_size for name, kind in KINDS.items()}


def draw(kind: str, seed: int, variant: Variant, size: float) -> Effect:
    """An effect of one kind, drawn by seed.

    Args:
        kind: One of `KINDS`.
        seed: Of joint, direction and strength.
        variant: The machine that the effect will change.
        size: Strength, 1 for a typical effect.

    Raises:
        InputError: No such kind, or a size that is not within its bounds.
    """
    if kind not in KINDS:
        raise InputError(
            f"effect {kind!r} is not known to the kinematic simulator; choose one of {', '.join(sorted(KINDS))}"
        )
    if not 0.0 < size <= KINDS[kind].largest_size:
        raise InputError(
            f"effect {kind}: size is {size}; it must be positive and at most {KINDS[kind].largest_size}"
        )
    return KINDS[kind].draw(np.random.default_rng(seed), variant, size)


__all__ = ["KINDS", "LARGEST_SIZE", "OUTSIDE", "Effect", "Kind", "Quantity", "draw"]
