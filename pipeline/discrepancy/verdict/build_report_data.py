"""From a verdict to what its report shows: tracks along time, signatures, the ranking, errors at all levels."""

from collections.abc import Collection, Sequence

import numpy as np

from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.diagnosis.prepare import PreparedLogs
from pipeline.discrepancy.diagnosis.training_support import uncovered_share
from pipeline.discrepancy.journal import Journal
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.grouping import source_of
from pipeline.discrepancy.selection.select import Selection
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, residual_of, velocity_of
from pipeline.discrepancy.verdict.report_data import LevelErrors, RankedEffect, ReportData, ResidualTrack
from pipeline.discrepancy.verdict.signature import signature_of
from pipeline.discrepancy.verdict.verdict import Verdict
from pipeline.machine.specification import CommandKind, MachineSpecification

TRACK_S = 15.0
LARGEST_UNCOVERED = 0.2  # of a joint's commands, without a warning
LARGEST_UNKNOWN = 0.3  # of a joint's motion, the same


def report_data_of(verdict: Verdict, journal: Journal) -> ReportData:
    """All that the report shows besides `closed_loop.json`."""
    diagnosis, logs, correction = verdict.diagnosis, verdict.logs, verdict.correction
    found = [member for effect in correction.effects for member in effect.members]
    new = [effect for effect in found if effect.known is None]
    before, after = (
        residual_of(diagnosis.simulation, diagnosis.held_out, of) for of in (diagnosis.known, found)
    )
    levels = [
        LevelErrors(
            steps=h,
            before=b.rmse,
            after=a.rmse,
            before_interval=b.interval(),
            after_interval=a.interval(),
            baselines={name: of[h] for name, of in correction.baselines.items()},
            nominal_floor=correction.floor[h],
            n_windows=len(b.squares),
        )
        for h, (b, a) in correction.errors.items()
    ]
    warnings = [
        f"{name} moves only {diagnosis.moving_s[index]:.0f} s in the rows used; an effect on it may go unseen."
        for index, name in enumerate(logs.joints)
        if index not in diagnosis.excited
    ]
    warnings += [
        f"{share:.0%} of {name}'s motion does not count: nominal logs hardly show how it moves there, or with as many "
        "joints at once."
        for name, share in zip(logs.joints, diagnosis.unknown_share, strict=True)
        if share > LARGEST_UNKNOWN
    ]
    if logs.is_of_one_machine:
        warnings.append(
            "Nominal and measured logs are the same: what the given model lacks of them is sought. "
            "The floor is that of a model that was identified from them."
        )
    if logs.machine.command_kind is not CommandKind.discrete:
        warnings += _extrapolations(logs)
    return ReportData(
        joints=logs.joints,
        units=logs.units,
        floor=np.sqrt(diagnosis.nominal.floor),
        before=np.sqrt(np.mean(before**2, axis=0)),
        after=np.sqrt(np.mean(after**2, axis=0)),
        autocorrelation_s=_autocorrelation_s(before, 2 * logs.machine.dt_s),
        tracks=_tracks(diagnosis, found),
        signatures=[one for effect in new if (one := signature_of(diagnosis, effect, found)) is not None],
        ranking=_ranking(verdict.selection, logs.machine, found),
        levels=levels,
        warnings=warnings,
        steps=journal.sentences,
        seconds=dict(journal.seconds),
    )


def _extrapolations(logs: PreparedLogs) -> list[str]:
    nominal, measured = (
        np.concatenate([trajectory.a for trajectory in part]) for part in (logs.nominal, logs.measured)
    )
    return [
        f"{share:.0%} of the commands to {joint} in the measured logs are of a size that nominal logs hardly hold. "
        "There, a machine that has changed and a model that never saw such commands look alike."
        for joint, share in zip(logs.joints, uncovered_share(nominal, measured), strict=True)
        if share > LARGEST_UNCOVERED
    ]


def _tracks(diagnosis: Diagnosis, found: Sequence[SelectedEffect]) -> list[ResidualTrack]:
    logs = diagnosis.logs
    n = round(TRACK_S / logs.machine.dt_s)
    residuals = []
    for present in (diagnosis.known, found):
        left = logs.sequences.velocity - velocity_of(diagnosis.simulation, present)
        residuals.append(diagnosis.is_known * left)
    tracks = []
    for index, trajectory in enumerate(logs.measured):
        n_blocks = max(1, (len(trajectory) - 1) // n)
        rows = slice(0, min(n_blocks * n, len(trajectory) - 1))
        pieces = [np.array_split(r[index, rows], n_blocks) for r in residuals]
        rms = [np.array([np.sqrt(np.mean(p**2, axis=0)) for p in piece]) for piece in pieces]
        purpose = np.array(
            [
                np.bincount(p, minlength=4).argmax()
                for p in np.array_split(logs.purposes[index][rows], n_blocks)
            ]
        )
        t_s = np.array([p.mean() for p in np.array_split(trajectory.t_s[rows], n_blocks)])
        tracks.append(ResidualTrack(trajectory.name, t_s, rms[0], rms[1], purpose))
    return tracks


def _ranking(
    selection: Selection, machine: MachineSpecification, found: Sequence[SelectedEffect]
) -> list[RankedEffect]:
    taken = {(f.candidate.family, f.candidate.joint) for f in found}
    lost = {(c.family, c.joint): why for f in found for c, why in f.losers}
    even = {(c.family, c.joint) for f in found for c in f.equivalents}
    ranked = []
    for c in sorted(selection.screened, key=lambda c: -c.share)[:30]:
        key = (c.family, c.joint)
        squares = c.gain / c.share if c.share > 0 else np.inf
        null_share = float(c.owed / squares)
        outcome = (
            "found"
            if key in taken
            else "cannot be told from what was found"
            if key in even
            else lost.get(key) or _why_not_found(selection, c, {f.candidate.joint for f in found})
        )
        ranked.append(
            RankedEffect(
                c.family,
                [machine.joint_names[c.joint]],
                source_of(c, machine),
                float(c.share),
                null_share,
                outcome,
            )
        )
    return ranked


def _why_not_found(selection: Selection, candidate: Candidate, joints: Collection[int]) -> str:
    """Why a candidate that never was a joint's rival came to nothing; `joints` have an effect of the verdict."""
    if not selection.comparison.passes(candidate):
        return "too little beyond what it removes on nominal logs"
    if candidate.joint in joints:
        return "less than what was found on this joint"
    return "nothing of this joint was confirmed, or nothing was left beside the others"


def _autocorrelation_s(residual: np.ndarray, step_s: float) -> np.ndarray:
    """(n_joint,) integrated autocorrelation time up to its first zero."""
    result = []
    for column in residual.T:
        column = column - column.mean()
        variance = float(column @ column)
        total = 1.0
        for lag in range(1, min(200, len(column))):
            value = float(column[lag:] @ column[:-lag]) / max(variance, 1e-18)
            if value <= 0.0:
                break
            total += 2.0 * value
        result.append(total * step_s)
    return np.array(result)
