"""How an effect shows on rows: what it changes there as it was fitted, and what the rows hold without it."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Hypothesis, Simulation
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.families.supply_variation import without_common_change
from pipeline.discrepancy.families.time_varying_gain import FAMILY as COURSE
from pipeline.discrepancy.families.time_varying_gain import beyond_constants
from pipeline.discrepancy.selection.onset import rows_since
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, hypothesis_of, residual_of

FEWEST_FREEDOM = 0.01  # of what one block alone shows: nothing is known of its scatter


class Deviation(NamedTuple):
    """Standard deviation of a size where there is no effect.

    Attributes:
        value: In units of the fitted size.
        freedom: Degrees of freedom by which it is known.
    """

    value: float
    freedom: float

    def and_of(self, other: "Deviation") -> "Deviation":
        """Of the sum of what both are of.

        Source: Satterthwaite (1946), An approximate distribution of estimates of variance components, Biometrics
        Bulletin 2.
        """
        of_both = self.value**2 + other.value**2
        freedom = of_both**2 / max(sum(of.value**4 / of.freedom for of in (self, other)), 1e-24)
        return Deviation(float(np.sqrt(of_both)), freedom)


class Shown(NamedTuple):
    """An effect on its k joints, in units of the noise floor's root.

    Attributes:
        change: (N, k) that it makes of the residual.
        residual: (N, k) without it, beside all others.
    """

    change: np.ndarray
    residual: np.ndarray

    @property
    def squares(self) -> float:
        """Of the change."""
        return float(np.sum(self.change**2))

    @property
    def size(self) -> float:
        """That the rows ask for, by least squares, in units of the fitted one."""
        return float(np.sum(self.change * self.residual)) / max(self.squares, 1e-12)

    @property
    def share(self) -> float:
        """Of the squared residual that it removes, as it was fitted."""
        before = float(np.sum(self.residual**2))
        return 1.0 - float(np.sum((self.residual - self.change) ** 2)) / max(before, 1e-12)

    def on(self, column: int) -> "Shown":
        """On one of its joints."""
        return Shown(*(of[:, [column]] for of in self))

    def deviation_by_blocks(self, block: np.ndarray) -> Deviation:
        """Of the size, robust against any correlation within blocks.

        Source: Liang and Zeger (1986), Longitudinal data analysis using generalized linear models, Biometrika 73.

        Args:
            block: (N,) index of each row's block.
        """
        scores = np.bincount(block, np.sum(self.change * (self.residual - self.size * self.change), axis=1))
        squares = np.bincount(block, np.sum(self.change**2, axis=1))
        n_blocks = self.squares**2 / max(float(np.sum(squares**2)), 1e-12)  # that show it
        value = float(np.sqrt(np.sum(scores**2))) / max(self.squares, 1e-12)
        return Deviation(value, max(n_blocks - 1.0, FEWEST_FREEDOM))


def shown_on(
    simulation: Simulation,
    rows: ScoredRows,
    found: Sequence[SelectedEffect],
    members: Sequence[SelectedEffect],
    beside: ScoredRows | None = None,
) -> Shown:
    """What one effect of the machine does on rows.

    Args:
        simulation: On the logs.
        rows: The rows.
        found: All effects on single joints.
        members: Those of them that the effect is made of.
        beside: Further rows that tell of a course in time.
    """
    joints = sorted({member.candidate.joint for member in members})
    shapes = {member.candidate.joint: member.candidate.point for member in members}
    family, active = members[0].candidate.family, hypothesis_of(simulation, found)
    if family == SUPPLY:
        without, left = _common_change(simulation, active, rows, members[0].candidate.onset, shapes)
    elif family == COURSE:
        pairs = [beyond_constants(simulation, active, rows, beside, joint, shapes[joint]) for joint in joints]
        without, left = (np.stack(of, axis=1) for of in zip(*pairs, strict=True))
    else:
        others = [f for f in found if not any(f is member for member in members)]
        without, left = (residual_of(simulation, rows, of)[:, joints] for of in (others, found))
    scale = np.sqrt(rows.floor[joints])
    return Shown((without - left) / scale, without / scale)


def _common_change(
    simulation: Simulation,
    active: Hypothesis,
    rows: ScoredRows,
    onset: int | None,
    shapes: Mapping[int, Mapping[str, float]],
) -> tuple[np.ndarray, np.ndarray]:
    """(N, k) residuals without and with a common change of speed, which acts from its onset on; 0 before it."""
    since, kept = (
        (rows, np.ones(len(rows.weight), bool)) if onset is None else rows_since(simulation, rows, onset)
    )
    without, left = np.zeros((2, len(kept), len(shapes)))
    if kept.any():
        widths_s = {joint: shapes[joint]["width"] for joint in sorted(shapes)}
        by_joint = without_common_change(simulation, active, since, widths_s)
        for column, (before, after) in enumerate(by_joint.values()):
            without[kept, column], left[kept, column] = before, after
    return without, left
