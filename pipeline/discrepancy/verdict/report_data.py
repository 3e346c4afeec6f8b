"""What a report shows of a closed loop besides `closed_loop.json`: arrays, in units of the joint."""

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Signature:
    """The residual over the variable that an effect depends on, with the fitted effect over it.

    Attributes:
        family: Of the effect.
        joint: Name.
        variable: What the abscissa is, with its unit, in words.
        along: Which way residuals are counted: name of an `effects.effect.Along`.
        x: (n_bin,) centres.
        before: (n_bin,) mean residual velocity of the model before, on rows held out from the fit.
        standard_error: (n_bin,) of `before`, by blocks.
        fitted: (n_bin,) mean change of velocity that the fitted effect makes.
        after: (n_bin,) mean residual with the effect.
        unit: Of the residuals, `rad/s` or `m/s`.
    """

    family: str
    joint: str
    variable: str
    along: str
    x: np.ndarray
    before: np.ndarray
    standard_error: np.ndarray
    fitted: np.ndarray
    after: np.ndarray
    unit: str


@dataclass(frozen=True)
class RankedEffect:
    """One hypothesis of the search.

    Attributes:
        family: Of the catalogue, or `other:<variable>`.
        joints: Names.
        source: Name of the joint whose variable it is, where that is another.
        share: Of the squared residual that it removes, alone, on rows that it was not fitted on.
        null_share: The most that the same hypothesis removes from the residual of nominal logs.
        outcome: `found`, or why it lost, in one clause.
    """

    family: str
    joints: list[str]
    source: str | None
    share: float
    null_share: float
    outcome: str


@dataclass(frozen=True)
class ResidualTrack:
    """Root mean square of the residual velocity along one log, per block of some seconds.

    Attributes:
        trajectory: Name.
        t_s: (n_block,) middle of the block, since the log's start.
        before: (n_block, n_joint).
        after: (n_block, n_joint).
        purpose: (n_block,) of `splits.Purpose`.
    """

    trajectory: str
    t_s: np.ndarray
    before: np.ndarray
    after: np.ndarray
    purpose: np.ndarray


@dataclass(frozen=True)
class LevelErrors:
    """Errors at one level of prediction on confirmation rows.

    Attributes:
        steps: 1, 80 or 1000.
        before: (n_joint,) root mean square, rad or m.
        after: (n_joint,).
        before_interval: (2, n_joint) 95 % by blocks.
        after_interval: (2, n_joint).
        baselines: Per baseline (`finetune`, `blackbox_residual`, `wrong_effect`) (n_joint,).
        nominal_floor: (n_joint,) the model's own error on held-out nominal logs.
        n_windows: Windows judged; 0: no stretch is long enough, arrays are NaN.
    """

    steps: int
    before: np.ndarray
    after: np.ndarray
    before_interval: np.ndarray
    after_interval: np.ndarray
    baselines: dict[str, np.ndarray]
    nominal_floor: np.ndarray
    n_windows: int


@dataclass(frozen=True)
class ReportData:
    """All of it.

    Attributes:
        joints: Names in order.
        units: Per joint `rad` or `m`.
        floor: (n_joint,) root mean square of the residual velocity on held-out nominal logs.
        before: (n_joint,) the same on measured logs.
        after: (n_joint,) with the effects.
        autocorrelation_s: (n_joint,) time over which the measured residual is correlated.
        tracks: Per measured log.
        signatures: Per effect and joint.
        ranking: Hypotheses by falling share.
        levels: One step, 80 steps, 1000 steps.
        warnings: What is hard to tell from these logs, one sentence each.
        steps: What the search did, one sentence per step.
        seconds: Wall-clock time by part.
    """

    joints: list[str]
    units: list[str]
    floor: np.ndarray
    before: np.ndarray
    after: np.ndarray
    autocorrelation_s: np.ndarray
    tracks: list[ResidualTrack]
    signatures: list[Signature]
    ranking: list[RankedEffect]
    levels: list[LevelErrors]
    warnings: list[str] = field(default_factory=list)
    steps: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)
