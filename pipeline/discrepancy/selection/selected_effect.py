"""Effects that were found, and the simulation in their presence."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Hypothesis, Simulation
from pipeline.discrepancy.families.uncorrectable import has_wrapper
from pipeline.discrepancy.selection.candidate import Candidate, with_candidate
from pipeline.discrepancy.selection.shares import Shares


@dataclass(frozen=True)
class Known:
    """What an earlier run found of an effect.

    Attributes:
        candidate: With the values and the onset that it had.
        deviations: Their standard deviations, by name of the point's values and `coefficient:<index>`; without one, a
            value is not known.
        correlated: Rows of a log that count as one in a fit.
        is_seen: Whether the present logs say something of it.
    """

    candidate: Candidate
    deviations: Mapping[str, float] = field(default_factory=dict)
    correlated: float = 1.0
    is_seen: bool = True

    def value_of(self, name: str | None, index: int) -> float:
        """Of the point's value of that name, or of the coefficient, 0 of one that was not freed."""
        candidate = self.candidate
        if name is not None:
            return float(candidate.point[name])
        return float(candidate.coefficients[index]) if index < len(candidate.coefficients) else 0.0


@dataclass(frozen=True)
class SelectedEffect:
    """One effect on one joint that the search took.

    Attributes:
        candidate: The effect.
        equivalents: Others that are as simple and not significantly worse, or without which it is not probable enough.
        losers: The next best, with a clause that says why they lost.
        known: What an earlier run found of it; None: it is new.
        shares: Of it and of what it was chosen before; empty where nothing was compared with it.
    """

    candidate: Candidate
    equivalents: list[Candidate] = field(default_factory=list)
    losers: list[tuple[Candidate, str]] = field(default_factory=list)
    known: Known | None = None
    shares: Shares = field(default_factory=dict)


def hypothesis_of(simulation: Simulation, found: Sequence[SelectedEffect]) -> Hypothesis:
    """That several effects are present, each from its onset on; those without a wrapper have no values."""
    hypothesis = NOMINAL
    for effect in found:
        if has_wrapper(effect.candidate):
            hypothesis = with_candidate(simulation, hypothesis, effect.candidate)
    return replace(hypothesis, onsets=onsets_of(found))


def onsets_of(found: Sequence[SelectedEffect]) -> dict[tuple[str, int], int]:
    """Stamp at which an effect on a joint sets in, where it does."""
    return {
        (f.candidate.family, f.candidate.joint): f.candidate.onset
        for f in found
        if f.candidate.onset is not None
    }


def velocity_of(simulation: Simulation, found: Sequence[SelectedEffect]) -> np.ndarray:
    """(B, T, n_joint) velocities in the presence of the effects."""
    return simulation.velocities([hypothesis_of(simulation, found)])[0]


def residual_of(simulation: Simulation, rows: ScoredRows, found: Sequence[SelectedEffect]) -> np.ndarray:
    """(N, n_joint) residual velocities in the presence of the effects, 0 where a joint does not count."""
    return rows.weight * rows.averaged(simulation.sequences.velocity - velocity_of(simulation, found))
