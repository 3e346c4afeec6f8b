"""Stage `judge`: selected models are judged on a recording that they never saw, beside an engineer's references."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.pages import write_page
from pipeline.configuration.paths import InputModel, InputPath, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.dynamics.judged_models import judge_models
from pipeline.dynamics.judgement import JudgeConfig, check_unseen
from pipeline.dynamics.references.all_references import References
from pipeline.dynamics.training.data_split import VALIDATION, split_by_purpose
from pipeline.effects.unaugmented_model import load_models
from pipeline.tracking import StageRun, progress_bar


@dataclass
class JudgeStage(PipelineConfiguration):
    """Keys of `conf/judge.yaml`."""

    judge: JudgeConfig = MISSING
    models: list[InputModel] = MISSING
    tuples: InputPath = MISSING
    held_out: InputPath = MISSING
    output: OutputFolder = MISSING
    page: bool = True


@stage(JudgeStage)
def main(configuration: JudgeStage, run: StageRun) -> None:
    """Fit the references, judge everything on the held-out recording, write metrics, tables and figures."""
    machine, output = configuration.machine, Path(configuration.output)
    models = load_models(configuration.models, machine)
    rows = split_by_purpose(configuration.tuples, configuration.held_out, [], machine)
    if rows.judged_on == VALIDATION:
        print("judge: no held-out recording; judged on the validation rows, which early stopping saw")
    else:
        check_unseen(rows.learning, rows.judged)
    parameters = [f"{path}/parameters.msgpack" for path in configuration.models]
    run.inputs(configuration.tuples, configuration.held_out, *parameters)
    n_predictors = len(models) + len(References.__dataclass_fields__)
    with progress_bar("judge", total=n_predictors, unit="predictor") as bar:
        judged = judge_models(models, rows, machine, configuration.judge, lambda name: bar.update())
    metrics = judged.save(output, machine)
    if configuration.page:
        write_page("judgement", output, machine)
    run.metrics(metrics)
    for name in judged.judgements:  # each has a run of its own, so that all have the same metric names
        with run.nested(name) as nested:
            own = {
                key.removeprefix(f"{name}."): metrics[key] for key in metrics if key.startswith(f"{name}.")
            }
            nested.metrics(own)
    run.artifact(output, "judgement")


if __name__ == "__main__":
    main()
