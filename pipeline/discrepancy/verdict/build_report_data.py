"""From a loop to what its report shows: tracks along time, signatures, the ranking, errors at all levels."""

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pipeline.discrepancy.acceptance.held_out_errors import WindowErrors
from pipeline.discrepancy.diagnosis.training_support import uncovered_share
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.grouping import MachineEffect
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, velocity_of
from pipeline.discrepancy.verdict.report_data import LevelErrors, RankedEffect, ReportData, ResidualTrack
from pipeline.discrepancy.verdict.signature import signature_of
from pipeline.machine.specification import CommandKind

if TYPE_CHECKING:
    from pipeline.discrepancy.close_loop import Loop

TRACK_S = 15.0
LARGEST_UNCOVERED = 0.2  # of a joint's commands, without a warning
LARGEST_UNKNOWN = 0.3  # of a joint's motion, the same


def evidence_of(
    loop: "Loop",
    effects: Sequence[MachineEffect],
    errors: Mapping[int, tuple[WindowErrors, WindowErrors]],
    floor: Mapping[int, np.ndarray],
    baselines: Mapping[str, Mapping[int, np.ndarray]],
) -> ReportData:
    """Gather it from a loop that has opened its confirmation rows."""
    found = [member for effect in effects for member in effect.members]
    before, after = loop.residual(loop.confirm, []), loop.residual(loop.confirm, found)
    levels = [
        LevelErrors(
            steps=h,
            before=b.rmse,
            after=a.rmse,
            before_interval=b.interval(),
            after_interval=a.interval(),
            baselines={name: of[h] for name, of in baselines.items()},
            nominal_floor=floor[h],
            n_windows=len(b.squares),
        )
        for h, (b, a) in errors.items()
    ]
    idle = [name for index, name in enumerate(loop.joints) if index not in loop.excited]
    warnings = [
        f"{name} moves only {loop.moving_s[loop.joints.index(name)]:.0f} s in the rows used; an effect on it may go "
        "unseen."
        for name in idle
    ]
    warnings += [
        f"{share:.0%} of {name}'s motion does not count: nominal logs hardly show how it moves there, or with as many "
        "joints at once."
        for name, share in zip(loop.joints, loop.unknown_share, strict=True)
        if share > LARGEST_UNKNOWN
    ]
    if loop.machine.command_kind is not CommandKind.discrete:
        warnings += _extrapolations(loop)
    return ReportData(
        joints=loop.joints,
        units=loop.units,
        floor=np.sqrt(loop.usual.floor),
        before=np.sqrt(np.mean(before**2, axis=0)),
        after=np.sqrt(np.mean(after**2, axis=0)),
        autocorrelation_s=_autocorrelation_s(before, 2 * loop.machine.dt_s),
        tracks=_tracks(loop, found),
        signatures=[one for effect in found if (one := signature_of(loop, effect, found)) is not None],
        ranking=_ranking(loop, found),
        levels=levels,
        warnings=warnings,
        steps=loop.steps,
        seconds=dict(loop.seconds),
    )


def _extrapolations(loop: "Loop") -> list[str]:
    nominal, measured = (
        np.concatenate([trajectory.a for trajectory in logs]) for logs in (loop.nominal, loop.measured)
    )
    return [
        f"{share:.0%} of the commands that {joint} gets in the measured logs lie where nominal logs hardly hold any: "
        "that the machine responds otherwise there, and that the model never learned how, look alike."
        for joint, share in zip(loop.joints, uncovered_share(nominal, measured), strict=True)
        if share > LARGEST_UNCOVERED
    ]


def _tracks(loop: "Loop", found: Sequence[SelectedEffect]) -> list[ResidualTrack]:
    n = round(TRACK_S / loop.machine.dt_s)
    residuals = []
    for present in ([], list(found)):
        residuals.append(loop.is_known * (loop.sequences.velocity - velocity_of(loop.simulation, present)))
    tracks = []
    for index, trajectory in enumerate(loop.measured):
        n_blocks = max(1, (len(trajectory) - 1) // n)
        rows = slice(0, min(n_blocks * n, len(trajectory) - 1))
        pieces = [np.array_split(r[index, rows], n_blocks) for r in residuals]
        rms = [np.array([np.sqrt(np.mean(p**2, axis=0)) for p in piece]) for piece in pieces]
        purpose = np.array(
            [
                np.bincount(p, minlength=4).argmax()
                for p in np.array_split(loop.purposes[index][rows], n_blocks)
            ]
        )
        t_s = np.array([p.mean() for p in np.array_split(trajectory.t_s[rows], n_blocks)])
        tracks.append(ResidualTrack(trajectory.name, t_s, rms[0], rms[1], purpose))
    return tracks


def _ranking(loop: "Loop", found: Sequence[SelectedEffect]) -> list[RankedEffect]:
    taken = {(f.candidate.family, f.candidate.joint) for f in found}
    lost = {(c.family, c.joint): why for f in found for c, why in f.losers}
    even = {(c.family, c.joint) for f in found for c in f.equivalents}
    ranked = []
    for c in sorted(loop.search.first, key=lambda c: -c.share)[:30]:
        key = (c.family, c.joint)
        squares = c.gain / c.share if c.share > 0 else np.inf
        null_share = float(c.owed / squares)
        outcome = (
            "found"
            if key in taken
            else "cannot be told from what was found"
            if key in even
            else lost.get(key) or _why_not_found(loop, c, {f.candidate.joint for f in found})
        )
        ranked.append(
            RankedEffect(
                c.family,
                [loop.joints[c.joint]],
                None if c.source is None else loop.joints[c.source],
                float(c.share),
                null_share,
                outcome,
            )
        )
    return ranked


def _why_not_found(loop: "Loop", candidate: Candidate, joints: Collection[int]) -> str:
    """Why a candidate that never was a joint's rival came to nothing; `joints` have an effect of the verdict."""
    if not loop.search.comparison.passes(candidate):
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
