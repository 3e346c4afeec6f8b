"""Joints that are clearly not as they were, though nothing in the catalogue or among the dependences says why."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.special import gammaln

from pipeline.discrepancy.acceptance.accept import Acceptance, is_given
from pipeline.discrepancy.acceptance.e_value import as_told, e_value_of
from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.families.plausibility import is_dependence
from pipeline.discrepancy.families.uncorrectable import has_wrapper
from pipeline.discrepancy.selection.grouping import OTHER, candidate_depends_on
from pipeline.discrepancy.selection.select import Selection
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, residual_of

# Of mean squares over the floor's, and over those of the other joints. Joints that are all off alike are no finding by
# themselves: where a log's rows fall just where its commands come in, jitter shifts starts by a step on all of them.
UNEXPLAINED_RATIO = 3.0


class Excess(NamedTuple):
    """Mean squares of the residual over the noise floor, and over the other joints' where these are above it.

    Attributes:
        of_all: (n_joint,).
        by_block: (n_blocks, n_joint).
    """

    of_all: np.ndarray
    by_block: np.ndarray


def unexplained(diagnosis: Diagnosis, selection: Selection, acceptance: Acceptance) -> list[dict[str, Any]]:
    """One entry of `effects`, without a name, per joint.

    Its residual has to stand out of the floor and of the other joints in rows for fitting and in confirmation rows
    each, and in more blocks than chance makes largest among those of the nominal logs.
    """
    joints = diagnosis.logs.joints
    # What is left of a joint beside a known effect, as beside one that is named, is the form that its card idealises.
    known = [f for f in selection.found if is_given(f)]
    idealised = {f.candidate.joint for f in known}
    parts = [_excess_of(diagnosis.simulation, rows, known) for rows in (diagnosis.rows, diagnosis.held_out)]
    nominal = _excess_of(diagnosis.nominal.simulation, diagnosis.nominal.rows, [])
    blocks = np.concatenate([part.by_block for part in parts])
    entries: list[dict[str, Any]] = []
    for joint, name in enumerate(joints):
        p_value = largest_of_all_p(blocks[:, joint], nominal.by_block[:, joint]) * len(joints)
        stands_out = all(part.of_all[joint] > UNEXPLAINED_RATIO for part in parts)
        e_value = e_value_of(p_value)
        if joint in idealised or not stands_out or e_value < diagnosis.logs.config.gate.smallest_e_value:
            continue
        # What the search came to, though the gate did not, says more than what was best before it looked closer. A
        # name says on what speeds depend where confirmation rows bore it out, and only predictions did not.
        searched = [f.candidate for f in selection.found]
        borne_out = [c for c in searched if acceptance.judgements[c.key].why_not is None]
        screened = [c for c in selection.screened if has_wrapper(c)]
        candidates = [
            *filter(is_dependence, borne_out),
            *filter(is_dependence, searched),
            *borne_out,
            *filter(is_dependence, screened),
        ]
        best = next((c for c in candidates if c.joint == joint), None)
        entries.append(
            {
                "family": OTHER,
                "joints": [name],
                "depends_on": [] if best is None else candidate_depends_on(best, diagnosis.logs.machine),
                "parameters": {},
                "onset": None,
                "certain": False,
                "probability": 1.0,
                **as_told(e_value),
                "error_reduction": 0.0,
            }
        )
    return entries


def _excess_of(simulation: Simulation, rows: ScoredRows, known: Sequence[SelectedEffect]) -> Excess:
    return excess(residual_of(simulation, rows, known), rows)


def excess(residual: np.ndarray, rows: ScoredRows) -> Excess:
    """Of a residual (N, n_joint) on `rows`."""
    ratio = residual**2 / rows.floor
    of_all = ratio.mean(axis=0)
    n_joint = len(of_all)
    others = [np.median(np.delete(of_all, joint)) if n_joint > 1 else 1.0 for joint in range(n_joint)]
    scale = np.maximum(1.0, others)
    n = rows.folds.n_blocks
    size = np.bincount(rows.folds.block, minlength=n)
    squares = np.stack([np.bincount(rows.folds.block, of, minlength=n) for of in ratio.T], axis=1)
    return Excess(of_all / scale, (squares[size > 0] / size[size > 0, None]) / scale)


def largest_of_all_p(measured: np.ndarray, nominal: np.ndarray) -> float:
    """How probable it is that so many of the largest of all blocks are measured ones, were all blocks alike.

    Exact, whatever their distribution: what is rare but large has little to show in most blocks. Source: Rosenbaum
    (1954), Tables for a nonparametric test of location, Annals of Mathematical Statistics 25.

    Args:
        measured: (n,) values.
        nominal: (m,) values.
    """
    n, m = len(measured), len(nominal)
    k = int(np.sum(measured > nominal.max(initial=-np.inf)))
    # k of n chosen, over k of n + m
    return float(np.exp(gammaln(n + 1) - gammaln(n - k + 1) - gammaln(n + m + 1) + gammaln(n + m - k + 1)))
