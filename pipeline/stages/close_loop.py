"""Stage `close_loop`: from logs measured on the machine to the effect that its model lacks."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from omegaconf import MISSING

from pipeline.configuration.load import ControlConfiguration
from pipeline.configuration.paths import InputLogs, InputModel, OutputFile
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.discrepancy.close_loop import close_loop
from pipeline.discrepancy.families.uncorrectable import WITHOUT_WRAPPER
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.discrepancy.unusable_logs import UnusableLogs
from pipeline.dynamics.judgement import seen_again
from pipeline.dynamics.model.dynamics_model import DynamicsModel, Target
from pipeline.dynamics.model.network import Parameterization, Parameters
from pipeline.dynamics.model.store import save_model
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.dynamics.training.fit import fit
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.store import FILE, save_effects
from pipeline.effects.unaugmented_model import load_plain_model_of
from pipeline.errors import InputError
from pipeline.files.atomic import write_whole
from pipeline.files.path_checks import Output
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.trajectories import load_trajectories
from pipeline.logs.tuples import Trajectory
from pipeline.reporting.closed_loop.report import write_closed_loop_report
from pipeline.reporting.page import render_page
from pipeline.tracking import StageRun, flatten_metrics
from pipeline.tracking.registry.publish import publish_dynamics_model


@dataclass
class CloseLoopStage(PipelineConfiguration):
    """Keys of `conf/close_loop.yaml`."""

    control: ControlConfiguration = MISSING
    ingest: IngestConfig = MISSING
    identify: IdentifyConfig = MISSING
    close_loop: CloseLoopConfig = MISSING
    nominal: InputLogs = MISSING
    measured: InputLogs = MISSING
    output: Annotated[str, Output(replaced=("model_before", "model_after"))] = MISSING
    model: InputModel | None = None
    learned: OutputFile | None = None
    kind: str = MISSING
    allow_empty: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.close_loop, CloseLoopConfig):
            return  # OmegaConf builds the node first and the object later
        known = [*KNOWN, *WITHOUT_WRAPPER]
        for family in self.close_loop.exclude:
            if family not in known:
                raise InputError(
                    f"close_loop.exclude has {family}, which is not tried anyway; choose from {', '.join(known)}"
                )


@stage(CloseLoopStage)
def main(configuration: CloseLoopStage, run: StageRun) -> None:
    """Write `closed_loop.json`, `report.html`, `model_before` and `model_after`."""
    machine, output = configuration.machine, Path(configuration.output)
    if configuration.allow_empty and is_empty(Path(configuration.measured)):
        write_note(configuration)
        return
    nominal, measured = (
        load_trajectories(Path(folder), machine, configuration.ingest, configuration.control.loop_tracker)
        for folder in (configuration.nominal, configuration.measured)
    )
    again = seen_again(nominal, measured)
    if again is not None:
        print(
            f"close_loop: caution: trajectory {again.name} of measured={configuration.measured} is among "
            f"nominal={configuration.nominal}, too; in what is the same nothing can be found",
            flush=True,
        )
    model, parameters = baseline(configuration, nominal)
    run.inputs(configuration.nominal, configuration.measured)
    print(f"close_loop: {len(nominal)} nominal and {len(measured)} measured trajectories", flush=True)
    kept = None if configuration.learned is None else Path(configuration.learned)
    try:
        result = close_loop(
            nominal,
            measured,
            machine,
            model,
            parameters,
            configuration.close_loop,
            lambda sentence: print(f"close_loop: {sentence}", flush=True),
            kept=kept,
        )
    except UnusableLogs as error:
        raise InputError(f"{error.which}={getattr(configuration, error.which)}: {error.why}") from None
    lineage = {"machine": machine.name, "trajectories": [trajectory.name for trajectory in nominal]}
    for name in ("model_before", "model_after"):
        save_model(output / name, model, parameters, lineage, {}, {})
        (output / name / FILE).unlink(missing_ok=True)
    if result.effects is not None:
        save_effects(output / "model_after", result.effects)
    content = json.dumps(result.document, indent=1, allow_nan=False) + "\n"
    write_closed_loop_report(
        output / "report.html",
        result.document,
        result.evidence,
        machine.name,
        configuration.nominal,
        configuration.measured,
    )
    write_whole(output / "closed_loop.json", content.encode())
    print(f"close_loop: verdict {result.document['verdict']}; see {output / 'report.html'}")
    run.metrics(
        flatten_metrics({"error": result.document["error"], "baselines": result.document["baselines"]})
    )
    for part in ("before", "after"):
        with run.nested(part) as nested:  # under the names that identify's runs have
            errors = {metric: values[part] for metric, values in result.document["error"].items()}
            nested.metrics(flatten_metrics({"model": errors}))
        publish_dynamics_model(
            run,
            output / f"model_{part}",
            model,
            f"{machine.name}-closed_loop",
            max(nominal, key=len),
            f"model_{part}",
            part,
        )
    run.artifact(output)


def is_empty(folder: Path) -> bool:
    """Whether there is nothing in the folder."""
    return folder.is_dir() and not any(folder.iterdir())


def write_note(configuration: CloseLoopStage) -> None:
    """Say in all outputs that there was nothing to close the loop with; the model stays as it is."""
    output = Path(configuration.output)
    if configuration.model is None:
        raise InputError(f"measured={configuration.measured}: holds no logs, and no model is named; name one")
    note = f"{configuration.measured} holds no logs; name logs of the machine as it is (params.yaml: measured_logs)"
    model, parameters = load_plain_model_of(Path(configuration.model), configuration.machine)
    for name in ("model_before", "model_after"):
        save_model(output / name, model, parameters, {"machine": configuration.machine.name}, {}, {})
        (output / name / FILE).unlink(missing_ok=True)
    page = render_page("The loop was not closed", f"{note}.", [], [], [])
    write_whole(output / "report.html", page.encode())
    write_whole(output / "closed_loop.json", (json.dumps({"note": note}, indent=1) + "\n").encode())
    print(f"close_loop: {note}")


def baseline(configuration: CloseLoopStage, nominal: list[Trajectory]) -> tuple[DynamicsModel, Parameters]:
    """The model that was given, or one identified from the nominal logs.

    Raises:
        InputError: The model is of another machine, has effects already, or cannot be read.
    """
    machine = configuration.machine
    if configuration.model is not None:
        return load_plain_model_of(Path(configuration.model), machine)
    parameterization, _, target = configuration.kind.partition("_")
    try:
        kind = Parameterization(parameterization), Target(target)
    except ValueError as error:
        raise InputError(
            f"kind={configuration.kind}: not a model kind; use mlp_dq, mlp_dqdot, kan_dq or kan_dqdot"
        ) from error
    settings = configuration.close_loop
    result = fit(nominal, machine, *kind, settings.baseline, configuration.identify, settings.seed)
    return result.model, result.parameters


if __name__ == "__main__":
    main()
