"""What an effect of a joint's starts and stops leaves of its signature: the right one next to nothing.

Causes that make a joint late differ in how it starts and stops, by less than most of their signature. The best of them
therefore passes every comparison with nothing and with chance, also where the catalogue lacks the cause. What it cannot
do is leave nothing behind: after a wrong one the residual still follows the joint's own starts and stops. It is
regressed on these, whatever its form, and counted on rows that the regression did not see. Starts that reverse a joint
count apart from those that go on: play shows after the first alone, a spool that sticks after both. Play also moves the
stops as the link's encoder reads them, so that an encoder which stops accuse is asked the same.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ROWS_AVERAGED, ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.families.plausibility import (
    BACKLASH,
    DELAY,
    LAG,
    OSCILLATION,
    SENSOR_BIAS,
    STICTION,
)
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, residual_of
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.effect import SMALLEST_COMMAND

OF_STARTS_AND_STOPS = (BACKLASH, DELAY, LAG, OSCILLATION, STICTION)
AFTER_S = 1.5  # a start or stop
RIDGE = 3.0  # starts or stops, of each column: what few of them say is not believed
# A mode that is damped more does not ring: it is one way of writing down that a joint is late.
RINGING = 0.6
# Of the squares that are left with an effect: where starts and stops explain less, the rest is what its form idealises
# and a noise that is larger, not the signature of another cause.
SMALLEST_OF_REST = 0.08


def doubted_by_what_is_left(
    simulation: Simulation,
    rows: ScoredRows,
    found: Sequence[SelectedEffect],
    screened: Sequence[Candidate],
    largest: float,
    dt_s: float,
) -> list[SelectedEffect]:
    """Effects after which a signature of starts and stops is still there have others among their equivalents.

    Args:
        simulation: On the measured logs.
        rows: For fitting and selection.
        found: All effects that passed the gate.
        screened: Candidates of the first screen.
        largest: Share of the squares which an effect removes, that what is left may come to.
        dt_s: Length of a time step.
    """
    after = residual_of(simulation, rows, found)
    doubted = []
    for effect in found:
        candidate = effect.candidate
        if candidate.family in (*OF_STARTS_AND_STOPS, SENSOR_BIAS):
            joint = candidate.joint
            without = residual_of(simulation, rows, [f for f in found if f is not effect])[:, joint]
            is_of_late_joint = candidate.point.get("damping_ratio", 0.0) > RINGING
            if is_of_late_joint or largest < remaining_share(
                without,
                after[:, joint],
                starts_and_stops(simulation, rows, candidate, dt_s),
                rows.folds.fold,
            ):
                effect = replace(effect, equivalents=[*effect.equivalents, *_others(effect, screened)])
        doubted.append(effect)
    return doubted


def _others(effect: SelectedEffect, screened: Sequence[Candidate]) -> list[Candidate]:
    """What its card is confounded with, of an encoder what starts and stops show, on its joint and not told yet."""
    candidate, told = effect.candidate, {c.family for c in effect.equivalents}
    is_encoder = candidate.family == SENSOR_BIAS
    confounded = OF_STARTS_AND_STOPS if is_encoder else KNOWN[candidate.family].card.confounded_with
    return [
        c
        for c in screened
        if c.joint == candidate.joint and c.family in confounded and c.family not in told and c.gain > 0.0
    ]


def remaining_share(without: np.ndarray, after: np.ndarray, columns: np.ndarray, fold: np.ndarray) -> float:
    """What starts and stops explain of the residual with an effect, as a share of the squares that it removes.

    Nothing where it is but a small part of what is left.

    Args:
        without: (N,) residual without the effect.
        after: (N,) residual with it.
        columns: (N, k) see `starts_and_stops`.
        fold: (N,) 0 or 1; coefficients of one are counted on the other.

    Returns:
        Not positive where they explain nothing on rows that they were not fitted on; 0 if the effect removes nothing.
    """
    removed = float(np.sum(without**2) - np.sum(after**2))
    if removed <= 0.0:
        return 0.0
    explained = 0.0
    for held_out in (0, 1):
        a, b = columns[fold != held_out], after[fold != held_out]
        coefficients = np.linalg.solve(a.T @ a + RIDGE * np.eye(a.shape[1]), a.T @ b)
        of_fold = after[fold == held_out]
        left = of_fold - columns[fold == held_out] @ coefficients
        explained += float(np.sum(of_fold**2) - np.sum(left**2))
    if explained < SMALLEST_OF_REST * float(np.sum(after**2)):
        return min(explained, 0.0) / removed
    return explained / removed


def starts_and_stops(
    simulation: Simulation, rows: ScoredRows, candidate: Candidate, dt_s: float
) -> np.ndarray:
    """(N, k) how long ago the joint's command began, to reverse it or to go on, or ceased to be of either sign.

    One column per kind and moment.

    Args:
        simulation: On the measured logs.
        rows: The N rows.
        candidate: Its joint's command; nothing counts until it surely has set in.
        dt_s: Length of a time step.
    """
    command = simulation.sequences.command[..., candidate.joint]
    command = np.sign(command) * (np.abs(command) >= SMALLEST_COMMAND)
    before = np.pad(command, ((0, 0), (1, 0)))[:, :-1]
    last = _last_motion(before)
    acts = np.ones(command.shape)
    if candidate.onset is not None:
        since = candidate.onset if candidate.onset_between is None else candidate.onset_between[1]
        acts = simulation.sequences.stamp_ns >= since
    events = []
    for sign in (-1.0, 1.0):
        start = (command == sign) & (before != sign)
        stop = (before == sign) & (command != sign)
        events += [start & (last == sign), start & (last == -sign), stop]  # a log's first start may be either
    columns = []
    for event in events:
        for first in range(0, round(AFTER_S / dt_s), ROWS_AVERAGED):
            during = np.zeros(command.shape)
            for lag in range(first, first + ROWS_AVERAGED):
                during[:, lag:] += event[:, : command.shape[1] - lag]
            columns.append(rows.averaged(acts * during))
    return np.stack(columns, axis=1) * rows.weight[:, [candidate.joint]]


def _last_motion(command: np.ndarray) -> np.ndarray:
    """(B, T) the command itself, at rest the one before the rest; 0 until there is one."""
    row = np.where(command != 0.0, np.arange(command.shape[1]), 0)
    return np.take_along_axis(command, np.maximum.accumulate(row, axis=1), axis=1)
