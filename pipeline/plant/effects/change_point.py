"""`change_point`: another effect that sets in at a random moment within the session."""

from dataclasses import replace

import numpy as np

from pipeline.plant.effects.effect import PlantEffect, Quantity, with_onset

EARLIEST, LATEST = 0.3, 0.7  # of the session


def wrap(random: np.random.Generator, effect: PlantEffect, session_s: float) -> PlantEffect:
    """`effect` from a random moment on; its truth gains the onset, in s since the session's start."""
    onset_s = random.uniform(EARLIEST, LATEST) * session_s
    truth = effect.truth | {"onset": Quantity(onset_s, "s")}
    return replace(with_onset(effect, onset_s), truth=truth)
