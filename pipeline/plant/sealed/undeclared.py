"""Undeclared effects of a set of sessions: drawn by seed, applied session by session."""

from collections.abc import Sequence

import numpy as np

from pipeline.errors import InputError
from pipeline.plant import effects
from pipeline.plant.effects import PlantEffect, change_point
from pipeline.plant.parameters import Parameters

DRAWN = "drawn"  # the kind itself is drawn
OR = "|"  # ... from these
CHANGE_POINT = "change_point"  # a drawn kind that sets in during the first session


def draw_effects(
    kinds: Sequence[str], seed: int, nominal: Parameters, size: float, first_session_s: float
) -> list[PlantEffect]:
    """Draw one effect per kind.

    Args:
        kinds: Names in `effects.KINDS`, `drawn`, or `change_point`; of names with `|` between them one is drawn.
        seed: Seed of kinds, joints, directions, strengths and moments.
        nominal: The machine that the effects will change.
        size: Strength, 1 for plain effects.
        first_session_s: Duration of the first session, within which a change point lies.

    Raises:
        InputError: A kind is unknown, or the size is not positive.
    """
    if not size > 0.0:
        raise InputError(f"effect_size is {size}; it must be positive")
    drawn = []
    for number, kind in enumerate(kinds):
        random = np.random.default_rng([seed, number])
        known = sorted(effects.KINDS)
        among = known if kind in (DRAWN, CHANGE_POINT) else kind.split(OR)
        for name in among:
            if name not in known:
                raise InputError(
                    f"effects: {name!r} is not known; choose from {', '.join((*known, CHANGE_POINT, DRAWN))}"
                )
        chosen = among[random.integers(len(among))] if len(among) > 1 else among[0]
        effect = effects.draw(chosen, int(random.integers(2**31)), nominal, size)
        drawn.append(change_point.wrap(random, effect, first_session_s) if kind == CHANGE_POINT else effect)
    return drawn


def parameters_of_session(
    nominal: Parameters, drawn: Sequence[PlantEffect], session: int
) -> tuple[Parameters, list[tuple[float, Parameters]]]:
    """The plant's parameters at the start of a session, and its changes during it.

    An effect with an onset sets in during the first session (number 0) and lasts from then on.

    Returns:
        Parameters at the start; later parameters, each with the time from which they hold, s, ascending.
    """
    parameters, changes = nominal, []
    later = sorted(
        (e for e in drawn if e.onset_s is not None and session == 0), key=lambda e: e.onset_s or 0.0
    )
    for effect in drawn:
        if effect not in later:
            parameters = effect.apply(parameters)
    changed = parameters
    for effect in later:
        changed = effect.apply(changed)
        changes.append((effect.onset_s or 0.0, changed))
    return parameters, changes
