"""What closing the loop leaves in its folder, and the record that its page is made from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.discrepancy.experiment.plan import FILE as PLAN
from pipeline.discrepancy.verdict.report_data import ReportData
from pipeline.discrepancy.verdict.result import ClosedLoop
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.model.store import save_model
from pipeline.effects.store import FILE, ActiveEffects, load_with_effects, save_effects
from pipeline.errors import InputError
from pipeline.files.atomic import write_json
from pipeline.files.record_file import save_record
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification

DOCUMENT, REPORT_DATA = "closed_loop.json", "report_data.npz"
PARTS = ("before", "after")  # each with its model, `model_before` and `model_after`


@dataclass(frozen=True)
class LoopReport:
    """What the page shows besides `closed_loop.json`.

    Attributes:
        machine: Its name.
        nominal: Where the nominal logs are from, in the user's words.
        measured: Likewise the measured logs.
        data: None where the loop was not closed.
    """

    machine: str
    nominal: str
    measured: str
    data: ReportData | None


def write_closed_loop(
    folder: Path,
    result: ClosedLoop,
    trajectories: Sequence[Trajectory],
    report: LoopReport,
) -> None:
    """Write `closed_loop.json`, `report_data.npz`, both models with their effects, and the plan.

    Args:
        folder: Where to.
        result: Of `close_loop`.
        trajectories: The nominal ones, named in the models' lineage.
        report: What the page shows.

    Raises:
        InputError: A file cannot be written.
    """
    lineage = {"machine": report.machine, "trajectories": [trajectory.name for trajectory in trajectories]}
    _write_models(folder, (result.model, result.parameters), lineage, result.given, result.effects)
    save_record(folder / REPORT_DATA, report)
    (folder / PLAN).unlink(missing_ok=True)
    if result.plan is not None:
        result.plan.write(folder / PLAN)
    _write_document(folder, result.document)


def write_note(
    folder: Path, machine: MachineSpecification, given: Path | None, nominal: str, measured: str
) -> str:
    """Say that there was nothing to close the loop with, and return the sentence; the given model stays as it is.

    Raises:
        InputError: No model is given, it cannot be used, or a file cannot be written.
    """
    if given is None:
        raise InputError(f"measured={measured}: holds no logs, and no model is named; name one")
    note = f"{measured} holds no logs; name logs of the machine as it is (params.yaml: measured_logs)"
    model, effects = load_with_effects(given, machine)
    _write_models(folder, model, {"machine": machine.name}, effects, effects)
    save_record(folder / REPORT_DATA, LoopReport(machine.name, nominal, measured, None))
    _write_document(folder, {"note": note})
    return note


def _write_models(
    folder: Path,
    model: tuple[DynamicsModel, Parameters],
    lineage: dict[str, Any],
    *effects: ActiveEffects | None,
) -> None:
    """`effects` are those of `PARTS`, in order."""
    for part, around in zip(PARTS, effects, strict=True):
        of_part = folder / f"model_{part}"
        save_model(of_part, *model, lineage, {}, {})
        (of_part / FILE).unlink(missing_ok=True)
        if around is not None:
            save_effects(of_part, around)


def _write_document(folder: Path, document: Mapping[str, Any]) -> None:
    write_json(folder / DOCUMENT, document, allow_nan=False)
