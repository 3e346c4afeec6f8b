"""The frozen model with effects around it, and what it is off by."""

from collections.abc import Sequence

import numpy as np

from pipeline.discrepancy.acceptance.held_out_errors import WindowErrors, window_errors
from pipeline.discrepancy.diagnosis.prepare import PreparedLogs
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.diagnosis.splits import Purpose
from pipeline.discrepancy.selection.grouping import MachineEffect
from pipeline.discrepancy.selection.selected_effect import hypothesis_of
from pipeline.dynamics.evaluation.errors import Predictor
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import Parameters
from pipeline.effects.store import ActiveEffects, predictor
from pipeline.logs.tuples import validation_part


class CorrectedModels:
    """Predictors, each compiled once, however often it is asked for."""

    def __init__(self, model: DynamicsModel, parameters: Parameters, simulation: Simulation) -> None:
        """Begin with the frozen model f_θ and θ; the simulation knows the effects."""
        self._model, self._parameters, self._simulation = model, parameters, simulation
        self._compiled: dict[tuple[int, ...], tuple[Sequence[MachineEffect], Predictor]] = {}

    def with_effects(self, effects: Sequence[MachineEffect]) -> Predictor:
        """The model with these effects."""
        key = tuple(id(member) for effect in effects for member in effect.members)
        if key not in self._compiled:
            # kept with the effects, so that no identity is used again
            active = active_effects(self._simulation, effects)
            self._compiled[key] = list(effects), predictor(self._model, self._parameters, active)
        return self._compiled[key][1]


def active_effects(simulation: Simulation, effects: Sequence[MachineEffect]) -> ActiveEffects | None:
    """What the model has around it; None: nothing."""
    found = [member for effect in effects if effect.has_wrapper for member in effect.members]
    if not found:
        return None
    hypothesis = hypothesis_of(simulation, found)
    onset_ns: dict[str, dict[int, int]] = {}
    for (family, joint), onset in hypothesis.onsets.items():
        onset_ns.setdefault(family, {})[joint] = onset
    return ActiveEffects(simulation.setting, hypothesis.values, onset_ns)


def held_out_errors(logs: PreparedLogs, of: Predictor, horizon: int) -> WindowErrors:
    """On confirmation rows."""
    allowed = [purpose == Purpose.confirm for purpose in logs.purposes]
    return window_errors(of, logs.measured, allowed, horizon)


def nominal_errors(logs: PreparedLogs, of: Predictor, horizon: int) -> np.ndarray:
    """(n_joint,) on the nominal logs' validation parts: what a correction costs the machine as it was."""
    parts = [validation_part(t) for t in logs.nominal]
    return window_errors(of, parts, [np.ones(len(p), bool) for p in parts], horizon).rmse
