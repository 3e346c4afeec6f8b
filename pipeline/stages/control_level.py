"""Stage `control_level`: the table of policies learned before and after closing the loop, on the changed machine."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import InputPath, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.plant.sealed.seal import open_seal
from pipeline.reporting.tables.control_level import control_level_table, load_runs
from pipeline.tracking import StageRun


@dataclass
class ControlLevelStage(PipelineConfiguration):
    """Keys of `conf/control_level.yaml`."""

    runs: InputPath = MISSING
    models: list[str] = MISSING
    seeds: list[int] = MISSING
    seal: InputPath = MISSING
    output: OutputFolder = MISSING


@stage(ControlLevelStage)
def main(configuration: ControlLevelStage, run: StageRun) -> None:
    """Gather the runs of all models and seeds."""
    runs = load_runs(Path(configuration.runs), configuration.models, configuration.seeds)
    effects = open_seal(Path(configuration.seal))
    table = control_level_table(runs, "; ".join(str(effect["cause"]) for effect in effects) or "unchanged")
    table.write(Path(configuration.output), "control_level")
    for model, of_model in runs.items():
        rate = sum(float(one["sr_012_008"]) for one in of_model) / len(of_model)
        run.metrics({f"{model}/sr_012_008": rate})
    run.artifact(Path(configuration.output), "control_level")


if __name__ == "__main__":
    main()
