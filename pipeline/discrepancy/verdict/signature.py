"""An effect's signature: the residual over what it depends on, where no fit saw it, with the fitted effect over it."""

from collections.abc import Sequence

import numpy as np

from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.diagnosis.prepare import PreparedLogs
from pipeline.discrepancy.diagnosis.sequences import Sequences
from pipeline.discrepancy.diagnosis.simulation import NOMINAL
from pipeline.discrepancy.families.time_varying_gain import FAMILY as COURSE
from pipeline.discrepancy.families.uncorrectable import has_wrapper
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, residual_of
from pipeline.discrepancy.verdict.report_data import Signature
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.effect import Abscissa, Along

PARTS = 16  # of equally many rows
ROWS_CORRELATED = 20  # of the residual: so many rows count as one
LONGEST_SINCE_S = 4.0


def signature_of(
    diagnosis: Diagnosis, effect: SelectedEffect, found: Sequence[SelectedEffect]
) -> Signature | None:
    """The signature of one effect on one joint, beside all others that were found; None where nothing varies.

    Args:
        diagnosis: Its confirmation rows have been opened.
        effect: One of `found`.
        found: All effects.
    """
    if effect.candidate.family == COURSE:
        return None  # parts of a log would average out what comes and goes
    logs, joint, rows = diagnosis.logs, effect.candidate.joint, diagnosis.held_out
    u = diagnosis.simulation.velocities([NOMINAL])[0][..., joint]
    over, along = _drawn(effect.candidate)
    variable, abscissa = _abscissa(logs, effect.candidate, over, u)
    sign = rows.averaged(_direction(along, logs.sequences.command[..., joint], u))
    others = [f for f in found if f is not effect]
    without, with_all = (
        sign * residual_of(diagnosis.simulation, rows, present)[:, joint] for present in (others, found)
    )
    x = rows.averaged(abscissa)
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, PARTS + 1)))
    if len(edges) < 3:
        return None
    which = np.clip(np.digitize(x, edges[1:-1]), 0, len(edges) - 2)
    counts = np.bincount(which, minlength=len(edges) - 1).clip(1)

    def mean(y: np.ndarray) -> np.ndarray:
        return np.bincount(which, y, minlength=len(counts)) / counts

    variance = np.maximum(mean(without**2) - mean(without) ** 2, 0.0)
    return Signature(
        family=effect.candidate.family,
        joint=logs.joints[joint],
        variable=variable,
        along=along.name,
        x=mean(x),
        before=mean(without),
        standard_error=np.sqrt(variance / np.maximum(counts / ROWS_CORRELATED, 1.0)),
        fitted=mean(without - with_all),
        after=mean(with_all),
        unit=f"{logs.units[joint]}/s",
    )


def _drawn(candidate: Candidate) -> tuple[Abscissa, Along]:
    """What has no wrapper has no card; it varies in time."""
    if not has_wrapper(candidate):
        return Abscissa.time, Along.motion
    card = KNOWN[candidate.family].card
    return card.drawn_over, card.counted_along


def _direction(along: Along, command: np.ndarray, u: np.ndarray) -> np.ndarray:
    """(B, T) by what the residual is multiplied: -1, 0 (nothing to tell there) or 1."""
    match along:
        case Along.motion:
            return np.sign(u)
        case Along.change:
            return last_change(command)
        case Along.axis:
            return np.ones(u.shape)


def last_change(command: np.ndarray) -> np.ndarray:
    """Sign of the last change of a command's sign, (B, T): of a start its direction, of a stop the opposite one."""
    change = np.sign(np.diff(np.sign(command), axis=1, prepend=0.0))
    place = np.where(change != 0.0, np.arange(command.shape[1]), 0)
    return np.take_along_axis(change, np.maximum.accumulate(place, axis=1), axis=1)


def _abscissa(
    logs: PreparedLogs, candidate: Candidate, over: Abscissa, u: np.ndarray
) -> tuple[str, np.ndarray]:
    """What an effect's signature is drawn over, in words, and its values (B, T)."""
    joint, sequences = candidate.joint, logs.sequences
    which = joint if candidate.source is None else candidate.source
    command = sequences.command
    match over:
        case Abscissa.position:
            return f"position of {logs.joints[which]} ({logs.units[which]})", sequences.q[..., which]
        case Abscissa.time:
            return "time since the log's start (s)", sequences.time_s
        case Abscissa.other_commands:
            size = np.abs(command)
            return "joints commanded besides this one", size.sum(axis=-1) - size[..., joint]
        case Abscissa.command:
            return f"command of {logs.joints[which]}", command[..., which]
        case Abscissa.since_command:
            name = f"time since the command of {logs.joints[joint]} last changed (s)"
            return name, since_change_s(sequences, joint)
        case Abscissa.velocity:
            name = f"velocity that the model predicts for {logs.joints[joint]} ({logs.units[joint]}/s)"
            return name, u
        case Abscissa.channel:
            channel, values = logs.machine.channels[which], sequences.channels[..., which]
            return f"{channel.name} ({channel.unit})", np.nan_to_num(values, nan=np.nanmedian(values))


def since_change_s(sequences: Sequences, joint: int) -> np.ndarray:
    """(B, T) time since the sign of a joint's command last changed, `LONGEST_SINCE_S` at most."""
    is_changed = np.diff(np.sign(sequences.command[..., joint]), axis=1, prepend=0.0) != 0.0
    step_s = float(np.median(np.diff(sequences.time_s[sequences.is_row])))
    since_s = np.zeros(is_changed.shape)
    for row in range(1, is_changed.shape[1]):
        since_s[:, row] = np.where(is_changed[:, row], 0.0, since_s[:, row - 1] + step_s)
    return np.minimum(since_s, LONGEST_SINCE_S)
