"""Errors of encoders that the stops show, and what they do to the speeds."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.families.plausibility import BACKLASH, GAIN, SENSOR_BIAS
from pipeline.discrepancy.families.stops import Encoder
from pipeline.discrepancy.selection.candidate import Candidate, scored
from pipeline.discrepancy.selection.regression import SURE_T, evidence, t_statistic
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, residual_of


def encoder_errors(
    simulation: Simulation,
    rows: ScoredRows,
    encoders: Mapping[int, Encoder],
    excluded: Sequence[str],
    joints: Sequence[str],
    log: Callable[[str], None],
) -> list[SelectedEffect]:
    """Where stops have moved, the encoder's error is known before anything else is looked for.

    Args:
        simulation: On the measured logs.
        rows: For fitting and selection.
        encoders: What the stops say, by joint.
        excluded: Families that are not tried.
        joints: Their names.
        log: Called with a sentence per joint whose stops have moved.
    """
    found = []
    for joint, encoder in encoders.items():
        if not encoder.errors or SENSOR_BIAS in excluded:
            continue
        options = [
            _at_stops(simulation, rows, SENSOR_BIAS, joint, error.point, encoder.onset, error.deviation)
            for error in encoder.errors
        ]
        candidate = max(options, key=lambda option: option.gain)  # a scale changes the speeds, too
        if BACKLASH not in excluded and _is_play(simulation, rows, joint, encoder, candidate):
            log(f"the stops of {joints[joint]} are read further in: by play rather than by its encoder")
        elif t_statistic(candidate.gain_by_block) < -SURE_T:
            log(f"the stops of {joints[joint]} have moved, but its speeds speak against its encoder")
        else:
            log(
                f"the stops of {joints[joint]} have moved by {encoder.z:.0f} standard deviations: its encoder"
            )
            found.append(SelectedEffect(candidate))
    return found


def is_refuted_by_stops(
    candidate: Candidate,
    encoders: Mapping[int, Encoder],
    found: Sequence[SelectedEffect],
    excluded: Sequence[str],
) -> bool:
    """Whether what the stops say of a joint's encoder speaks against a candidate on it.

    Args:
        candidate: Of the screen.
        encoders: What the stops say, by joint.
        found: Effects beside it.
        excluded: Families that are not tried. Without `sensor_bias` a joint whose stops moved has no `gain` either:
            what moves stops scales speeds, too.
    """
    encoder = encoders.get(candidate.joint)
    if candidate.family == GAIN and SENSOR_BIAS in excluded:
        return encoder is not None and bool(encoder.errors)
    if candidate.family != SENSOR_BIAS:
        return False
    # Play moves the stops, too: beside it they say nothing of the encoder.
    has_play = any(f.candidate.family == BACKLASH and f.candidate.joint == candidate.joint for f in found)
    return has_play or (encoder is not None and not encoder.allows(candidate.point))


def _is_play(
    simulation: Simulation, rows: ScoredRows, joint: int, encoder: Encoder, candidate: Candidate
) -> bool:
    """Whether stops are read further in, and play by as much explains more of the speeds than the encoder's error."""
    width, deviation = {"width": 2.0 * encoder.inward}, 2.0 * encoder.errors[0].deviation
    return encoder.inward > 0.0 and (
        _at_stops(simulation, rows, BACKLASH, joint, width, encoder.onset, deviation).gain > candidate.gain
    )


def _at_stops(
    simulation: Simulation,
    rows: ScoredRows,
    family: str,
    joint: int,
    point: Mapping[str, float],
    onset: int | None,
    deviation: float,
) -> Candidate:
    """An effect whose parameters the stops gave, and what it does to the speeds."""
    nothing = np.zeros(0)
    seen_at_stops = partial(replace, onset=onset, deviation=deviation)
    blank = seen_at_stops(Candidate(family, joint, None, point, (), nothing, 0.0, 0.0, nothing))
    before = residual_of(simulation, rows, [])[:, joint]
    after = residual_of(simulation, rows, [SelectedEffect(blank)])[:, joint]
    seen = evidence(before, after, np.zeros((len(before), 0)), rows.folds, nothing, nothing)
    return seen_at_stops(scored(seen, before, rows.floor[joint], family, joint, None, point, ()))
