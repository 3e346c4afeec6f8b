"""Closing the loop: from logs measured on the machine to the effect that its model lacks.

Each step is a function from the records of the steps before to a record of its own, which nothing changes later:
prepare, diagnose, select, accept, correct, plan the next experiment. Their records together are the verdict. Only
`accept` and what follows sees the confirmation rows.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

from pipeline.discrepancy.acceptance.accept import accept
from pipeline.discrepancy.correction.correct import correct
from pipeline.discrepancy.correction.given_effects import refuse_given
from pipeline.discrepancy.diagnosis.diagnose import diagnose
from pipeline.discrepancy.diagnosis.nominal_behaviour import NominalBehaviour
from pipeline.discrepancy.diagnosis.prepare import prepare
from pipeline.discrepancy.experiment.plan_experiment import plan_experiment
from pipeline.discrepancy.journal import Journal
from pipeline.discrepancy.selection.select import select
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.discrepancy.unusable_logs import UnusableLogs
from pipeline.discrepancy.verdict.build_report_data import report_data_of
from pipeline.discrepancy.verdict.document import document_of
from pipeline.discrepancy.verdict.result import ClosedLoop
from pipeline.discrepancy.verdict.verdict import Verdict
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.effects.store import ActiveEffects
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification


def close_loop(
    nominal: Sequence[Trajectory],
    measured: Sequence[Trajectory] | None,
    machine: MachineSpecification,
    model: tuple[DynamicsModel, Parameters] | None,
    config: CloseLoopConfig,
    identify: IdentifyConfig,
    log: Callable[[str], None] = lambda _: None,
    nominal_behaviour: NominalBehaviour | None = None,
    kept: Path | None = None,
    given: ActiveEffects | None = None,
) -> ClosedLoop:
    """Find the effects that a model lacks of the machine that was measured.

    A model may have effects already, of an earlier run. Their values and deviations are the prior of a new fit to the
    measured logs, which says what became of them; what is found is new.

    Args:
        nominal: Logs of the machine that the model describes.
        measured: Logs of the machine as it is; None: the nominal ones, of which the model may lack something.
        machine: Its specification.
        model: The frozen model f_θ and θ; None: the diagnosis model, so that one model is diagnosed and corrected.
        config: Section `close_loop`.
        identify: Section `identify`, by which the diagnosis model is trained.
        log: Called with one sentence per step.
        nominal_behaviour: What the nominal logs say, if it has been learned for other measured logs already.
        kept: File that keeps it; see `learn_nominal_behaviour`.
        given: Effects that the model has already; the nominal logs are of the machine without them.

    Raises:
        InputError: That file is damaged, or cannot be written; neither measured logs nor a model are given; the nominal
            logs show the given effects.
        UnusableLogs: The logs are too short, or there are none.
    """
    journal = Journal(log)
    if measured is None and model is None:
        raise InputError("neither measured logs nor a model are named; name one, or both")
    if not nominal or (measured is not None and not measured):
        raise UnusableLogs("measured" if nominal else "nominal", "there are none; give one at least")
    if given is not None and model is not None:
        refuse_given(given, model, nominal if measured is not None else (), machine.joint_names, config)
    logs = prepare(nominal, nominal if measured is None else measured, machine, config, identify)
    diagnosis = diagnose(logs, nominal_behaviour, kept, journal, model if measured is None else None, given)
    selection = select(diagnosis, journal)
    acceptance = accept(diagnosis, selection, journal)
    own = diagnosis.nominal.diagnosis
    frozen, parameters = model or (own.model, own.parameters)
    correction = correct(frozen, parameters, diagnosis, selection, acceptance, journal)
    plan = plan_experiment(diagnosis, selection, correction, journal)
    verdict = Verdict(diagnosis, selection, acceptance, correction, plan)
    evidence = report_data_of(verdict, journal)
    return ClosedLoop(document_of(verdict), frozen, parameters, correction.active, evidence, plan, given)
