"""Effects that were fitted together, grouped to effects of the machine."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.acceptance.parameter_misfit import misfit_covariance
from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.families.plausibility import TIMING
from pipeline.discrepancy.selection.free_parameters import Coordinate
from pipeline.discrepancy.selection.grouping import MachineEffect, effects_of
from pipeline.discrepancy.selection.refine import parameter_covariance, refine
from pipeline.discrepancy.selection.selected_effect import SelectedEffect


@dataclass(frozen=True)
class FittedEffects:
    """Values that belong together: none makes room for an effect that is not among them.

    Attributes:
        diagnosis: On whose rows they were fitted.
        found: On single joints, in the order in which they were fitted.
        effects: The same grouped, strongest first.
    """

    diagnosis: Diagnosis
    found: Sequence[SelectedEffect]
    effects: Sequence[MachineEffect]

    @functools.cached_property
    def covariance(self) -> Mapping[int, tuple[list[Coordinate], np.ndarray]]:
        """Per joint its coordinates, and what scatter and misfit make of them, (k, k)."""
        nominal, found = self.diagnosis.nominal, list(self.found)
        misfit = misfit_covariance(nominal.simulation, nominal.rows, found)
        scatter = parameter_covariance(self.diagnosis.simulation, self.diagnosis.rows, found)
        return {joint: (of, covariance + misfit[joint]) for joint, (of, covariance) in scatter.items()}


def grouped(diagnosis: Diagnosis, found: Sequence[SelectedEffect]) -> FittedEffects:
    """Effects that are fitted already; what is known and what is new are no one effect."""
    allow_timing = TIMING not in diagnosis.logs.config.exclude
    parts = [f for f in found if f.known is not None], [f for f in found if f.known is None]
    effects = [effect for of in parts for effect in effects_of(of, diagnosis.excited, allow_timing)]
    return FittedEffects(diagnosis, found, sorted(effects, key=lambda effect: -effect.gain))


def refitted(diagnosis: Diagnosis, found: Sequence[SelectedEffect]) -> FittedEffects:
    """Effects that are left of others, fitted again on the rows for fitting."""
    return grouped(diagnosis, refine(diagnosis.simulation, diagnosis.rows, found))
