"""The gate: what an effect has to pass on confirmation rows before it is reported."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.errors import InputError

MOST_OF_CHANGE = 0.95


@dataclass
class GateConfig:
    """Thresholds of the gate.

    Attributes:
        smallest_error_reduction: Of the open-loop error over 80 steps on its joints, for an effect to be named.
        smallest_share: Of the squared residual, instead, for the strongest effect: one that hardly moves positions.
        smallest_improvement: Lower bound of the held-out reduction of an effect's squared residual.
        confidence: Of that bound, one-sided. It need not bear the search's multiplicity, which `largest_p` does.
        largest_p: After correction for all hypotheses searched.
        largest_rank_p: The same of a change that cannot be shifted in time, a creep at rest: by the gains' ranks over
            blocks of confirmation rows, which nothing was searched on.
        largest_disagreement: Share of its fitted size by which an effect may be larger or smaller in one log, beyond
            scatter.
        worse_margin: Relative rise of a joint's open-loop error that still counts as none, as does one that
            blocks do not bear out.
        resamples: Of the bootstrap.
        model_error: Share of a parameter by which the idealised effect may differ from the real one; widens intervals.
        smallest_excitation_s: Time in motion that a joint has to have in the logs for a verdict on it.
    """

    smallest_improvement: float
    confidence: float
    smallest_error_reduction: float
    smallest_share: float
    largest_p: float
    largest_rank_p: float
    largest_disagreement: float
    worse_margin: float
    resamples: int
    model_error: float
    smallest_excitation_s: float

    def __post_init__(self) -> None:
        for name in ("largest_p", "largest_rank_p", "confidence"):
            if not 0 < getattr(self, name) < 1:
                raise InputError(f"close_loop.gate.{name} is {getattr(self, name)}; it must be in (0, 1)")
        if not self.largest_disagreement > 0:
            raise InputError(
                f"close_loop.gate.largest_disagreement is {self.largest_disagreement}; it must be positive"
            )
        if not self.model_error >= 0:
            raise InputError(f"close_loop.gate.model_error is {self.model_error}; it must not be negative")


def lower_bound(
    before: np.ndarray,
    after: np.ndarray,
    rows: ScoredRows,
    resamples: int,
    confidence: float,
    seed: int,
    only: np.ndarray | None = None,
) -> tuple[float, float]:
    """Held-out share of the squares that an effect removes, and its lower bound by a block bootstrap.

    Args:
        before: (N,) residual without the effect.
        after: (N,) with it.
        rows: The rows.
        resamples: Of the bootstrap.
        confidence: Of the bound.
        seed: Of the resampling.
        only: (N,) which of the rows, in whole blocks but where an effect sets in; None: all.
    """
    n, block = rows.folds.n_blocks, rows.folds.block
    if only is not None:
        before, after = before[only], after[only]
        blocks, block = np.unique(block[only], return_inverse=True)
        n = len(blocks)
    if not np.any(before):
        return 0.0, -np.inf  # nothing to remove is no evidence
    squares = [np.bincount(block, residual**2, minlength=n) for residual in (before, after)]
    drawn = np.random.default_rng(seed).integers(n, size=(resamples, n))
    share = 1.0 - squares[1][drawn].sum(axis=1) / np.maximum(squares[0][drawn].sum(axis=1), 1e-12)
    total = 1.0 - squares[1].sum() / max(squares[0].sum(), 1e-12)
    return float(total), float(np.quantile(share, 1.0 - confidence))


def where_it_acts(before: np.ndarray, after: np.ndarray, rows: ScoredRows) -> np.ndarray:
    """(N,) rows of the fewest blocks that hold `MOST_OF_CHANGE` of the squares by which an effect changes a residual.

    A bound over all blocks is one over how often the effect is met, too: of two blocks in thirty that show it clearly,
    one resample in seven has none.

    Args:
        before: (N,) residual without the effect.
        after: (N,) with it.
        rows: The rows.
    """
    change = np.bincount(rows.folds.block, (before - after) ** 2, minlength=rows.folds.n_blocks)
    order = np.argsort(-change)
    earlier = np.cumsum(change[order]) - change[order]
    acts = np.zeros(len(change), bool)
    acts[order] = earlier < MOST_OF_CHANGE * change.sum()
    return acts[rows.folds.block]


def pooled(residual: np.ndarray, joints: Sequence[int], scale: np.ndarray) -> np.ndarray:
    """(N,) what several joints' residuals come to: the root of their squares, each joint in units of its scale.

    Args:
        residual: (N, n_joint).
        joints: Which.
        scale: (n_joint,) mean squares that count as one.
    """
    joints = list(joints)
    return np.sqrt(np.sum(residual[:, joints] ** 2 / scale[joints], axis=1))


def rank_p(gain_by_block: np.ndarray, n_tests: int) -> float:
    """How probable so many and so large gains are on rows that nothing was searched on, were gains and losses alike.

    By ranks, as a few blocks may hold most of the gain. Source: Wilcoxon (1945), Individual comparisons by ranking
    methods, Biometrics Bulletin 1.

    Args:
        gain_by_block: (n_blocks,) on confirmation rows.
        n_tests: Effects that are confirmed on these rows, for which the result is corrected.
    """
    from scipy.stats import wilcoxon  # takes a second to import, and few runs need it

    if not np.any(gain_by_block):
        return 1.0
    return float(min(1.0, wilcoxon(gain_by_block, alternative="greater").pvalue * n_tests))
