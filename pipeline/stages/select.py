"""Stage `select`: of each study's trials one is selected, by the rule that the profile states."""

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path

import jax
import yaml
from omegaconf import MISSING

from pipeline.configuration.paths import InputPath, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.dynamics.evaluation.inference_time import count_parameters, time_step, unit_scale_model
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.search.selection import explain, select, within_margin
from pipeline.dynamics.search.trial_table import read_candidates
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.errors import InputError
from pipeline.reporting.results.paper import KIND_NAMES
from pipeline.reporting.tables.selection import (
    SelectedModels,
    published_training,
    record,
    selection_table,
    table_csv,
)
from pipeline.study.configuration import SearchConfig
from pipeline.tracking import StageRun


@dataclass
class SelectStage(PipelineConfiguration):
    """Keys of `conf/select.yaml`."""

    identify: IdentifyConfig = MISSING
    search: SearchConfig = MISSING
    searched: InputPath = MISSING
    output: OutputFolder = MISSING


@stage(SelectStage)
def main(configuration: SelectStage, run: StageRun) -> None:
    """Select a model per searched kind and write the paper's table, ours beside the published one."""
    searched, output = Path(configuration.searched), Path(configuration.output)
    kinds = [kind for kind in KIND_NAMES if (searched / kind / "trials.csv").is_file()]
    if not kinds:
        raise InputError(
            f"searched={searched}: no folder KIND/trials.csv, KIND one of {', '.join(KIND_NAMES)}; "
            "run the stage search"
        )
    selections = [select_kind(configuration, kind) for kind in kinds]
    table = selection_table(
        selections, configuration.search.selection, configuration.profile, jax.devices()[0].device_kind
    )
    output.mkdir(parents=True, exist_ok=True)
    (output / "selected_models.md").write_text(table.markdown(), encoding="utf-8")
    (output / "selected_models.tex").write_text(table.latex(), encoding="utf-8")
    (output / "selected_models.csv").write_text(table_csv(table), encoding="utf-8")
    for selection in selections:
        content = json.dumps(record(selection), indent=1, ensure_ascii=False)
        (output / f"{selection.kind}.json").write_text(content + "\n", encoding="utf-8")
    snippet = "# For section `identify` of a profile, or the command line of the stage identify.\n"
    selected = {selection.kind: dataclasses.asdict(selection.winner.training) for selection in selections}
    snippet += yaml.safe_dump({"selected": selected}, sort_keys=False, default_flow_style=None)
    (output / "selected.yaml").write_text(snippet, encoding="utf-8")
    for selection in selections:
        run.metrics(
            {
                f"{selection.kind}.evaluation_loss": selection.winner.evaluation_loss,
                f"{selection.kind}.n_parameters": selection.winner.n_parameters,
                f"{selection.kind}.step_time_s": selection.winner.inference_time_s,
            }
        )
    run.artifact(output, "selection")
    print(table.markdown())


def select_kind(configuration: SelectStage, kind: str) -> SelectedModels:
    """Measure the candidates within the margin, and select."""
    rule, n_calls = configuration.search.selection, configuration.search.timed_calls
    degree = configuration.identify.legendre_degree
    path = Path(configuration.searched) / kind / "trials.csv"
    candidates = read_candidates(path)
    if not candidates:
        raise InputError(f"{path}: no trial was completed; search with other hyper-parameters")
    times = {}
    measured = []
    for candidate in within_margin(candidates, rule):
        model = unit_scale_model(configuration.machine, *parts(kind), candidate.training, degree)
        if count_parameters(model) != candidate.n_parameters:
            raise InputError(
                f"{path}: trial {candidate.trial} has {candidate.n_parameters} parameters, with this machine and "
                f"identify.legendre_degree={degree} it would have {count_parameters(model)}; search again"
            )
        times[candidate.trial] = time_step(model, n_calls)
        measured.append(dataclasses.replace(candidate, inference_time_s=times[candidate.trial].median_s))
    winner = select(measured, rule)
    published = unit_scale_model(configuration.machine, *parts(kind), published_training(kind), degree)
    return SelectedModels(
        kind,
        winner,
        explain(winner, measured, rule),
        measured,
        times,
        count_parameters(published),
        time_step(published, n_calls),
    )


def parts(kind: str) -> tuple[Parameterization, Target]:
    """Parameterization and target of a kind."""
    parameterization, target = kind.split("_")
    return Parameterization(parameterization), Target(target)


if __name__ == "__main__":
    main()
