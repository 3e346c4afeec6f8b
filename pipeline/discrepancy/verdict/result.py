"""What closing the loop gives."""

from dataclasses import dataclass
from typing import Any

from pipeline.discrepancy.experiment.plan import Plan
from pipeline.discrepancy.verdict.report_data import ReportData
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import Parameters
from pipeline.effects.store import ActiveEffects


@dataclass(frozen=True)
class ClosedLoop:
    """The result.

    Attributes:
        document: closed_loop.json (contract, section 4).
        model: The frozen model that the loop was closed on.
        parameters: Its parameters.
        effects: What `model_after` has around the frozen model; None: nothing.
        given: What `model_before` has, likewise.
        evidence: For the report.
        plan: The next experiment; None: none is planned.
    """

    document: dict[str, Any]
    model: DynamicsModel
    parameters: Parameters
    effects: ActiveEffects | None
    evidence: ReportData
    plan: Plan | None = None
    given: ActiveEffects | None = None
