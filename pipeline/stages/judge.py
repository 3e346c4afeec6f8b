"""Stage `judge`: selected models are judged on a recording that they never saw, beside an engineer's references."""

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import InputModel, InputPath, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.dynamics.evaluation.errors import Predictor
from pipeline.dynamics.judgement import JudgeConfig, ModelJudgement, check_unseen, flat_metrics, judge_fully
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.references.all_references import References, fit_references
from pipeline.dynamics.training.data_split import VALIDATION, split_by_purpose
from pipeline.effects.unaugmented_model import load_plain_model_of
from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification
from pipeline.reporting.figures.models import error_growth_band_figure, open_loop_prediction_figure
from pipeline.reporting.tables.judgement import (
    ReferenceComparison,
    display_name,
    error_comparison,
    extrapolation_comparison,
    grey_box_table,
    growth_comparison,
    growth_rows,
    narx_table,
)
from pipeline.tracking import StageRun, progress_bar


@dataclass
class JudgeStage(PipelineConfiguration):
    """Keys of `conf/judge.yaml`."""

    judge: JudgeConfig = MISSING
    models: list[InputModel] = MISSING
    tuples: InputPath = MISSING
    held_out: InputPath = MISSING
    output: OutputFolder = MISSING


@stage(JudgeStage)
def main(configuration: JudgeStage, run: StageRun) -> None:
    """Fit the references, judge everything on the held-out recording, write figures, tables and metrics."""
    machine, config, output = configuration.machine, configuration.judge, Path(configuration.output)
    models = load_models(configuration.models, machine)
    rows = split_by_purpose(Path(configuration.tuples), Path(configuration.held_out), [], machine)
    if rows.judged_on == VALIDATION:
        print("judge: no held-out recording; judged on the validation rows, which early stopping saw")
    else:
        check_unseen(rows.learning, rows.judged)
    run.inputs(
        configuration.tuples,
        configuration.held_out,
        *(f"{path}/parameters.msgpack" for path in configuration.models),
    )
    fitted = fit_references(rows.learning, machine, config.arx, config.narx, config.grey_box)
    references: dict[str, Predictor] = dict(vars(fitted))
    with progress_bar("judge", total=len(models) + len(references), unit="predictor") as bar:
        judgements = judge_fully(
            models | references, rows.learning, rows.judged, machine, config, lambda name: bar.update()
        )
    comparisons = {
        "errors": error_comparison(judgements, list(references), machine, rows.judged_on),
        "error_growth": growth_comparison(judgements, list(references), machine, config.growth.confidence),
        "extrapolation": extrapolation_comparison(
            judgements, list(references), machine, config.extrapolation
        ),
    }
    metrics = flat_metrics(judgements, machine) | {
        f"reference_wins.{name}": len(comparison.won_by_references())
        for name, comparison in comparisons.items()
    }
    write_tables(output / "tables", comparisons, judgements, fitted, machine)
    write_figures(output / "figures", judgements, list(references), machine)
    (output / "judgement.json").write_text(
        json.dumps(metrics, indent=1, sort_keys=True, allow_nan=False) + "\n"
    )
    content = {name: comparison.content() for name, comparison in comparisons.items()}
    (output / "comparisons.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    for name, comparison in comparisons.items():
        print(f"{name}: {comparison.sentence()}")
    run.metrics(metrics)
    for predictor in judgements:  # each has a run of its own, so that all have the same metric names
        with run.nested(predictor) as nested:
            prefix = f"{predictor}."
            nested.metrics(
                {key.removeprefix(prefix): metrics[key] for key in metrics if key.startswith(prefix)}
            )
    run.artifact(output, "judgement")


def load_models(paths: Sequence[str], machine: MachineSpecification) -> dict[str, Predictor]:
    """The models by their folders' names."""
    if not paths:
        raise InputError("models is empty; name at least one model folder, models=[PATH]")
    models: dict[str, Predictor] = {}
    for path in paths:
        name = Path(path).resolve().name
        model, parameters = load_plain_model_of(Path(path), machine)
        if name in models or name in References.__dataclass_fields__:
            raise InputError(f"{path}: another predictor is called {name} already; rename the folder")
        models[name] = LearnedPredictor(model, parameters, has_stops=False)  # as the references
    return models


def write_tables(
    folder: Path,
    comparisons: Mapping[str, ReferenceComparison],
    judgements: Mapping[str, ModelJudgement],
    references: References,
    machine: MachineSpecification,
) -> None:
    """Each comparison as Markdown and CSV, the error growth at every horizon, and what was fitted."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, comparison in comparisons.items():
        (folder / f"{name}.md").write_text(comparison.markdown(), encoding="utf-8")
        every_horizon = growth_rows(judgements, machine)  # with bands, where the table has a few horizons
        write_csv(folder / f"{name}.csv", *(every_horizon if name == "error_growth" else comparison.tidy()))
    for name, table in (
        ("narx", narx_table(references.narx, machine)),
        ("grey_box", grey_box_table(references.grey_box, machine)),
    ):
        (folder / f"{name}.md").write_text(table.markdown(), encoding="utf-8")


def write_figures(
    folder: Path,
    judgements: Mapping[str, ModelJudgement],
    references: Sequence[str],
    machine: MachineSpecification,
) -> None:
    """Open-loop predictions of the models and of the references, and error growth of all."""
    folder.mkdir(parents=True, exist_ok=True)
    names, units = machine.joint_names, machine.units
    for file, own in (
        ("open_loop_models.svg", [name for name in judgements if name not in references]),
        ("open_loop_references.svg", references),
    ):
        predictions = {display_name(name): judgements[name].open_loop for name in own}
        (folder / file).write_bytes(open_loop_prediction_figure(predictions, names, units))
    growth = {display_name(name): one.growth for name, one in judgements.items()}
    shown = [display_name(name) for name in references]
    figure = error_growth_band_figure(growth, shown, machine.dt_s, names, units)
    (folder / "error_growth.svg").write_bytes(figure)


def write_csv(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A CSV file with a header."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


if __name__ == "__main__":
    main()
