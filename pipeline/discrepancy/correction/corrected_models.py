"""The frozen model with effects around it, and what it is off by."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects
from pipeline.discrepancy.acceptance.held_out_errors import WindowErrors, window_errors
from pipeline.discrepancy.acceptance.value_deviations import value_deviations
from pipeline.discrepancy.correction.follow_speed import FilterValues, best_filter, filters_of
from pipeline.discrepancy.diagnosis.prepare import PreparedLogs
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.diagnosis.splits import Purpose
from pipeline.discrepancy.selection.grouping import MachineEffect
from pipeline.discrepancy.selection.selected_effect import hypothesis_of, onsets_of
from pipeline.dynamics.evaluation.errors import OPEN_LOOP_HORIZON, Predictor
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import Parameters
from pipeline.effects.dependence import OnChannel
from pipeline.effects.store import ActiveEffects, augmented, predictor
from pipeline.effects.varying_speed import FAMILY
from pipeline.logs.tuples import validation_part


class CorrectedModels:
    """Predictors, each compiled once, however often it is asked for."""

    def __init__(self, model: DynamicsModel, parameters: Parameters, simulation: Simulation) -> None:
        """Begin with the frozen model f_θ and θ; the simulation knows the effects."""
        self._model, self._parameters, self._simulation = model, parameters, simulation
        self._compiled: dict[tuple[int, ...], tuple[Sequence[MachineEffect], Predictor]] = {}
        self._filter: FilterValues | None = None  # of speeds that vary without an equation

    def with_effects(self, effects: Sequence[MachineEffect]) -> Predictor:
        """The model with these effects."""
        key = tuple(id(member) for effect in effects for member in effect.members)
        if key not in self._compiled:
            # kept with the effects, so that no identity is used again
            active = self.active(effects)
            self._compiled[key] = list(effects), predictor(self._model, self._parameters, active)
        return self._compiled[key][1]

    def follow(self, logs: PreparedLogs, effects: Sequence[MachineEffect], noise: np.ndarray) -> None:
        """Fit what follows effects without an equation, beside those that have one; arguments as of `filters_of`."""
        if not (tried := filters_of(effects, noise)):
            return
        allowed = [(of == Purpose.fit) | (of == Purpose.select) for of in logs.purposes]
        without = window_errors(self.with_effects(effects), logs.measured, allowed, OPEN_LOOP_HORIZON)
        active = _with_filter(self._simulation, active_effects(self._simulation, effects), effects, tried[0])
        model = augmented(self._model, self._parameters, active)

        def errors(of: FilterValues) -> WindowErrors:
            return window_errors(
                model.with_values({**active.values, FAMILY: of}), logs.measured, allowed, OPEN_LOOP_HORIZON
            )

        self._filter = best_filter(tried, errors, without)
        self._compiled.clear()

    def active(self, effects: Sequence[MachineEffect]) -> ActiveEffects | None:
        """What the model has around it; None: nothing."""
        active = active_effects(self._simulation, effects)
        if self._filter is None or all(effect.has_wrapper for effect in effects):
            return active
        return _with_filter(self._simulation, active, effects, self._filter)


def active_effects(simulation: Simulation, effects: Sequence[MachineEffect]) -> ActiveEffects | None:
    """What has an equation; None: nothing."""
    found = [member for effect in effects if effect.has_wrapper for member in effect.members]
    if not found:
        return None
    hypothesis = hypothesis_of(simulation, found)
    onset_ns: dict[str, dict[int, int]] = {}
    earlier = onsets_of([replace(f, candidate=f.known.candidate) for f in found if f.known is not None])
    for (family, joint), onset in {**earlier, **hypothesis.onsets}.items():
        onset_ns.setdefault(family, {})[joint] = onset
    is_on_channel = OnChannel.card.family in hypothesis.values
    setting = simulation.setting if is_on_channel else replace(simulation.setting, channels=())
    return ActiveEffects(setting, hypothesis.values, onset_ns)


def _with_filter(
    simulation: Simulation,
    active: ActiveEffects | None,
    effects: Sequence[MachineEffect],
    values: FilterValues,
) -> ActiveEffects:
    """Effects and the filter of those among them that have no equation, from their onsets on."""
    members = [member.candidate for effect in effects if not effect.has_wrapper for member in effect.members]
    is_followed = np.isin(np.arange(simulation.setting.n_joint), [of.joint for of in members])
    of_these = {name: np.where(is_followed, values[name], 0.0) for name in ("common_std", "own_std")}
    onsets = {of.joint: of.onset for of in members if of.onset is not None}
    known = active or ActiveEffects(replace(simulation.setting, channels=()), {}, {})
    return ActiveEffects(
        known.setting,
        {**known.values, FAMILY: {**values, **of_these}},
        {**known.onset_ns, **({FAMILY: onsets} if onsets else {})},
    )


def with_deviations(effects: ActiveEffects | None, fit: FittedEffects) -> ActiveEffects | None:
    """The effects, and how far their values may be off."""
    if effects is None:
        return None
    deviations = {family: of for family, of in value_deviations(fit).items() if family in effects.values}
    return replace(effects, deviations=deviations)


def held_out_errors(logs: PreparedLogs, of: Predictor, horizon: int) -> WindowErrors:
    """On confirmation rows."""
    allowed = [purpose == Purpose.confirm for purpose in logs.purposes]
    return window_errors(of, logs.measured, allowed, horizon)


def nominal_errors(logs: PreparedLogs, of: Predictor, horizon: int) -> np.ndarray:
    """(n_joint,) on the nominal logs' validation parts: what a correction costs the machine as it was."""
    parts = [validation_part(t) for t in logs.nominal]
    return window_errors(of, parts, [np.ones(len(p), bool) for p in parts], horizon).rmse
