"""Step 5: the model with the effects that do no harm, its errors, and those of what else could be done."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.acceptance.accept import Acceptance
from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects, refitted
from pipeline.discrepancy.acceptance.held_out_errors import WindowErrors
from pipeline.discrepancy.baselines.all_baselines import trained_baselines, wrong_effect
from pipeline.discrepancy.correction.corrected_models import (
    CorrectedModels,
    held_out_errors,
    nominal_errors,
    with_deviations,
)
from pipeline.discrepancy.correction.open_loop_gate import OpenLoopGate
from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.diagnosis.prepare import PreparedLogs
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.journal import Journal
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.grouping import OTHER, MachineEffect, contract_family
from pipeline.discrepancy.selection.select import Selection
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.dynamics.evaluation.errors import Predictor
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.effects.store import ActiveEffects, predictor

LEVELS = (1, 80, 1000)


class Alternative(NamedTuple):
    """What an effect was chosen before, on one joint.

    Attributes:
        candidate: The rival.
        chosen: Family of the effect.
        why_not: A clause that says why the rival lost; None: the logs cannot tell them apart.
        error_reduction: Share of the squared error over 80 steps that the rival removes by itself.
        probability: Of the rival, given that something has changed.
    """

    candidate: Candidate
    chosen: str
    why_not: str | None
    error_reduction: float
    probability: float


@dataclass(frozen=True)
class Correction:
    """The model before and after.

    Attributes:
        fit: Effects that stay.
        effects: The same as the verdict tells them, strongest first.
        error_reductions: Per new effect, as of `Alternative`.
        alternatives: To all new effects.
        active: What the model has around it; None: nothing.
        errors: By number of steps: on confirmation rows, before and after.
        floor: By number of steps (n_joint,) the frozen model's errors on nominal validation parts [rad, m].
        baselines: By name and number of steps (n_joint,) errors on confirmation rows.
        on_nominal: By name (n_joint,) errors of corrections over 80 steps on nominal validation parts.
    """

    fit: FittedEffects
    effects: Sequence[MachineEffect]
    error_reductions: Sequence[float]
    alternatives: Sequence[Alternative]
    active: ActiveEffects | None
    errors: Mapping[int, tuple[WindowErrors, WindowErrors]]
    floor: Mapping[int, np.ndarray]
    baselines: Mapping[str, Mapping[int, np.ndarray]]
    on_nominal: Mapping[str, np.ndarray]

    @property
    def new(self) -> list[MachineEffect]:
        """Effects that the given model does not have."""
        return [effect for effect in self.effects if not effect.is_known]


def correct(
    model: DynamicsModel,
    parameters: Parameters,
    diagnosis: Diagnosis,
    selection: Selection,
    acceptance: Acceptance,
    journal: Journal,
) -> Correction:
    """Put the accepted effects around the frozen model f_θ, but for those that make its predictions worse.

    The model before has the effects that it was given with.
    """
    logs, config = diagnosis.logs, diagnosis.logs.config
    models = CorrectedModels(model, parameters, diagnosis.simulation)
    before = predictor(model, parameters, diagnosis.given)
    of_before = {horizon: held_out_errors(logs, before, horizon) for horizon in LEVELS}
    # Of the logs that a model lacks something of: what one that was identified from them is off by.
    own = diagnosis.nominal.diagnosis
    usual = (own.model, own.parameters) if logs.is_of_one_machine else (model, parameters)
    floor = {horizon: nominal_errors(logs, LearnedPredictor(*usual), horizon) for horizon in LEVELS}
    models.follow(logs, acceptance.fit.effects, floor[1])
    known = [effect for effect in acceptance.fit.effects if effect.is_known]
    gate = OpenLoopGate(
        before=of_before[80]
        if diagnosis.given is None
        else held_out_errors(logs, models.with_effects(known), 80),
        known=known,
        errors=lambda of: held_out_errors(logs, models.with_effects(of), 80),
        refit=lambda of: refitted(diagnosis, [member for effect in of for member in effect.members]),
        config=config.gate,
        log=journal.log,
    )
    fit = gate.passing(acceptance.fit, lambda effect: _shows(effect, diagnosis, acceptance))
    effects = fit.effects
    new = [effect for effect in effects if not effect.is_known]
    after = models.with_effects(effects)
    errors = {
        horizon: (
            of_before[horizon],
            held_out_errors(logs, after, horizon) if effects or diagnosis.given else of_before[horizon],
        )
        for horizon in LEVELS
    }
    journal.end_part("errors before and after")
    trained = _trained_baselines(model, parameters, diagnosis)
    baselines = _errors_of_rivals(logs, models, trained, wrong_effect(effects, selection.screened))
    on_nominal = {"effects": nominal_errors(logs, after, 80) if effects else floor[80]}
    on_nominal |= {name: nominal_errors(logs, of, 80) for name, of in trained.items()}
    journal.end_part("baselines")
    return Correction(
        fit,
        effects,
        [gate.error_reduction(effect) for effect in effects if not effect.is_known],
        _alternatives(new, gate),
        with_deviations(models.active(effects), fit),
        errors,
        floor,
        baselines,
        on_nominal,
    )


def _errors_of_rivals(
    logs: PreparedLogs,
    models: CorrectedModels,
    trained: Mapping[str, Predictor],
    wrong: MachineEffect | None,
) -> dict[str, dict[int, np.ndarray]]:
    """By name and number of steps (n_joint,), where any was trained; a wrong effect is one of them."""
    rivals = {**trained, "wrong_effect": models.with_effects([wrong])} if trained and wrong else trained
    return {name: {h: held_out_errors(logs, of, h).rmse for h in LEVELS} for name, of in rivals.items()}


def _trained_baselines(
    model: DynamicsModel, parameters: Parameters, diagnosis: Diagnosis
) -> dict[str, Predictor]:
    """What else could be done, by name; nothing unless it is asked for."""
    logs, config = diagnosis.logs, diagnosis.logs.config
    if not config.baselines:
        return {}
    of = logs.measured, logs.purposes, logs.machine, config.baselines_budget, config.seed
    return trained_baselines(model, parameters, *of)


def _alternatives(effects: Sequence[MachineEffect], gate: OpenLoopGate) -> list[Alternative]:
    result = []
    for effect in effects:
        for member in effect.members:
            name = effect.family if effect.family != OTHER else member.candidate.family
            even = [(c, None) for c in member.equivalents] if effect.equivalents else []
            for candidate, why_not in [*even, *member.losers]:
                rival = MachineEffect(contract_family(candidate), [SelectedEffect(candidate)])
                of = gate.error_reduction(rival), member.shares.get(candidate.key, 0.0)
                result.append(Alternative(candidate, name, why_not, *of))
    return result


def _shows(effect: MachineEffect, diagnosis: Diagnosis, acceptance: Acceptance) -> bool:
    """Whether an effect that removes little of the open-loop error shows in a good part of the speeds' residual.

    Of what is seldom met, confirmation rows may show but a moment: on the rows that it was found on.
    """
    if effect.family == SUPPLY:
        return True
    candidates = [member.candidate for member in effect.members]
    share = max(max(c.share, acceptance.judgements[c.key].share) for c in candidates)
    return share > diagnosis.logs.config.gate.smallest_share
