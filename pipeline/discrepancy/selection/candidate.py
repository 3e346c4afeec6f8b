"""One effect on one joint, and what it explains."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.diagnosis.simulation import Hypothesis, Simulation
from pipeline.discrepancy.selection.regression import CrossValidatedFit, t_statistic
from pipeline.effects.effect import Variant

FEWEST_ACTING = 4  # blocks
Key = tuple[str, int, int | None]
"""Family, joint and source."""


@dataclass(frozen=True)
class Candidate:
    """One effect on one joint.

    Attributes:
        family: Of the catalogue, or `other:<variable>`.
        joint: Index.
        source: Index of the joint whose variable it is; None: the joint's own, or the machine's.
        point: Values of the parameters that are not linear.
        freed: The linear parameters that were freed.
        coefficients: Changes of the freed parameters from their neutral values.
        gain: Held-out reduction of squares, in units of the joint's noise floor.
        share: The same as a share of the squares before.
        gain_by_block: The same as `gain`, per block.
        onset: Absolute stamp, ns, from which on it acts; None: all the time.
        onset_between: Absolute stamps, ns, between which the rows do not tell one moment from the other.
        deviation: Standard deviation of `point`, where something else than the velocities gave it, and it is not fitted
            to them.
        owed: Of the gain, what is the diagnosis model's misfit: what the same effect explains here with the values that
            it has on nominal logs, but no more than a multiple of what it explains there.
    """

    family: str
    joint: int
    source: int | None
    point: Mapping[str, float]
    freed: Variant
    coefficients: np.ndarray
    gain: float
    share: float
    gain_by_block: np.ndarray = field(repr=False)
    onset: int | None = None
    onset_between: tuple[int, int] | None = None
    deviation: float | None = None
    owed: float = 0.0

    @property
    def key(self) -> Key:
        """What tells it from the others of a screen, and from the other effects found."""
        return self.family, self.joint, self.source

    @property
    def n_parameters(self) -> int:
        """How many values it has that can be chosen."""
        return len(self.point) + len(self.coefficients)

    @property
    def t(self) -> float:
        """Of its gain, by blocks: of what sets in, by those that it acts in, as there is nothing to gain before.

        By all of them where those are too few to tell their scatter.
        """
        by_block = self.gain_by_block
        acting = by_block if self.onset is None else by_block[by_block != 0.0]
        return t_statistic(acting if len(acting) >= FEWEST_ACTING else by_block)

    def index_of(self, name: str) -> int | None:
        """Where among the coefficients the first is that this parameter has; None: it was not freed."""
        return next((i for i, one in enumerate(self.freed) if one[0][0] == name), None)

    def coefficient_of(self, name: str) -> float:
        """Change of a parameter from its neutral value; 0 where it was not freed."""
        index = self.index_of(name)
        return 0.0 if index is None else float(self.coefficients[index])


class Misfit(NamedTuple):
    """What explains something of nominal logs, where there is nothing to be found.

    Attributes:
        candidate: With the values that it has there.
        most_per_row: The most that a candidate of the same kind owes to it, per used row.
    """

    candidate: Candidate
    most_per_row: float


Nominal = Mapping[Key, Misfit]


def scored(
    found: CrossValidatedFit,
    reference: np.ndarray,
    floor: float,
    family: str,
    joint: int,
    source: int | None,
    point: Mapping[str, float],
    freed: Variant,
) -> Candidate:
    """A candidate with its evidence: gains in units of `floor`, the share of the squares of `reference` (N,)."""
    squares = max(float(np.sum(reference**2)), 1e-12)
    gain_by_block = found.gain_by_block / floor
    return Candidate(
        family,
        joint,
        source,
        point,
        freed,
        found.coefficients,
        found.gain / floor,
        found.gain / squares,
        gain_by_block,
    )


def with_candidate(simulation: Simulation, active: Hypothesis, candidate: Candidate) -> Hypothesis:
    """The active effects, with their onsets, and the candidate's values."""
    values = {
        family: {name: np.array(value, np.float64) for name, value in of.items()}
        for family, of in active.values.items()
    }
    neutral = simulation.effects[candidate.family].neutral()
    of = values.setdefault(candidate.family, neutral)
    j = candidate.joint
    for name, value in candidate.point.items():
        of[name][j] = value
    for freed, coefficient in zip(candidate.freed, candidate.coefficients, strict=True):
        for name, index in freed:
            place = (j,) if index is None else (j, *np.atleast_1d(index))
            of[name][place] = neutral[name][place] + coefficient
    return Hypothesis(values, active.onsets)
