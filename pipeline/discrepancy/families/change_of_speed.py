"""A change of joints' speeds over time that is no function of anything measured: v_j = u_j e^{z(t)}.

There is nothing to regress on. z is estimated from residuals elsewhere, of other joints (`supply_variation.py`) or at
other times (`time_varying_gain.py`), and it is tried whether it predicts the residual here.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Hypothesis, Simulation
from pipeline.discrepancy.selection.candidate import Candidate, Nominal, scored
from pipeline.discrepancy.selection.regression import CrossValidatedFit, evidence

PRIOR_STD = 0.1  # of z: keeps the estimate at zero where nothing moves
MOST_OF_ESTIMATE = 2.0  # the most that a joint follows an estimate of z, which is shrunk towards zero


class ChangeOfSpeed(ABC):
    """An estimate of z for every joint, at any width in time, and what it explains.

    Attributes:
        family: Name of the effect.
        widths_s: Widths in time that are tried.
        velocity: (B, T, n_joint) as predicted.
        product: (B, T, n_joint) residual times velocity where they are known, in units of the noise floor.
        square: The same of the squared velocity: z is about the ratio of sums of both.
        reference: (N, n_joint) residual on the rows in use.
    """

    family: ClassVar[str]
    widths_s: ClassVar[tuple[float, ...]]

    def __init__(
        self, simulation: Simulation, active: Hypothesis, rows: ScoredRows, known: np.ndarray
    ) -> None:
        """Predict once.

        Args:
            simulation: On the logs.
            active: Effects beside it.
            rows: Rows on which it is scored.
            known: (B, T, 1 or n_joint) weight of the rows that tell of z.
        """
        self.rows = rows
        self.dt_s = simulation.setting.dt_s
        self.velocity = simulation.velocities([active])[0]
        residual = simulation.sequences.velocity - self.velocity
        self.product = known * residual * self.velocity / rows.floor
        self.square = known * self.velocity**2 / rows.floor
        self.reference = rows.weight * rows.averaged(residual)

    @abstractmethod
    def of(self, joint: int, width: float) -> np.ndarray:
        """Estimate z of a joint, (B, T), from everything but what it is tried on, over a width in s."""

    def ratio(self, product: np.ndarray, square: np.ndarray, total: np.ndarray) -> np.ndarray:
        """Product by square, drawn to zero where little is known.

        Args:
            product: Of residual and velocity, summed or averaged over rows.
            square: Of the velocity, likewise.
            total: The same as a sum.
        """
        return product / np.maximum(square, 1e-9) * self.shrinkage(total)

    def shrinkage(self, total: np.ndarray) -> np.ndarray:
        """How far an estimate of z is believed, by the sum of squared velocities over its rows."""
        # The floor's correlation leaves about one independent value per second.
        information = np.maximum(total, 0.0) * self.dt_s
        return information / (information + 1.0 / PRIOR_STD**2)

    def regressor(self, joint: int, z: np.ndarray) -> np.ndarray:
        """(N,) change of the joint's velocity."""
        return self.rows.weight[:, joint] * self.rows.averaged(z * self.velocity[..., joint])

    def candidates(self, nominal: Nominal) -> list[Candidate]:
        """One candidate per joint, at its best shape.

        Args:
            nominal: What explains nominal logs; as much per row is owed, as it is another draw of the same process.
        """
        n = len(self.rows.folds.fold)
        best = []
        for joint in range(self.velocity.shape[-1]):
            candidate = max(self.options(joint), key=lambda option: option.gain)
            if candidate.key in nominal:
                candidate = replace(candidate, owed=nominal[candidate.key].most_per_row * n)
            best.append(candidate)
        return best

    def options(self, joint: int) -> list[Candidate]:
        """What is tried on a joint; the arguments of `of` are each one's `point`."""
        return [self.candidate(joint, {"width": width_s}) for width_s in self.widths_s]

    def evidence(self, joint: int, shape: Mapping[str, float]) -> CrossValidatedFit:
        """How well the estimate of z of a shape explains the joint's residual."""
        reference = self.reference[:, joint]
        regressor = self.regressor(joint, self.of(joint, **shape))[:, None]
        bounds = np.array([0.0]), np.array([MOST_OF_ESTIMATE])
        return evidence(reference, reference, regressor, self.rows.folds, *bounds)

    def candidate(self, joint: int, shape: Mapping[str, float]) -> Candidate:
        """The candidate of a shape, nothing owed yet."""
        found, floor = self.evidence(joint, shape), self.rows.floor[joint]
        return scored(found, self.reference[:, joint], floor, self.family, joint, None, dict(shape), ())
