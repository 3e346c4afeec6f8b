"""Stage `evaluate_logs`: the errors of any saved model on any logs; where the logs hold targets, reaching, the delays
that were seen, and what safety did."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY, ControlConfiguration
from pipeline.configuration.paths import InputLogs, InputModel, OutputFile
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.deployment.graph_logs.evaluate_logs import evaluate_logs
from pipeline.files.atomic import write_json
from pipeline.logs.ingest_config import IngestConfig
from pipeline.reaching.episodes import EpisodesConfig
from pipeline.tracking import StageRun, flatten_metrics


@dataclass
class EvaluateLogsStage(PipelineConfiguration):
    """Keys of `conf/evaluate_logs.yaml`."""

    control: ControlConfiguration = MISSING
    ingest: IngestConfig = MISSING
    episodes: EpisodesConfig = MISSING
    model: InputModel = MISSING
    logs: InputLogs = MISSING
    output: OutputFile = MISSING
    allow_empty: bool = MISSING


@stage(EvaluateLogsStage)
def main(configuration: EvaluateLogsStage, run: StageRun) -> None:
    """Write one JSON file (contract, section 3)."""
    machine, logs, output = configuration.machine, configuration.logs, Path(configuration.output)
    if configuration.allow_empty and not Path(logs).exists():
        note = f"{logs}: no logs"
        write_json(output, {"note": note})
        print(f"evaluate_logs: {note}")
        return
    evaluation = evaluate_logs(
        Path(configuration.model),
        Path(logs),
        machine,
        MACHINE_DIRECTORY,
        configuration.ingest,
        configuration.control.loop_tracker,
        configuration.episodes.steps,
        log=print,
    )
    write_json(output, evaluation, sort_keys=True, allow_nan=False)
    for name in ("one_step_rmse", "open_loop_rmse_80"):
        values = zip(machine.joint_names, machine.units, evaluation[name].values(), strict=True)
        print(f"{name}: " + ", ".join(f"{joint} {value:.5f} {unit}" for joint, unit, value in values))
    run.metrics(flatten_metrics({key: value for key, value in evaluation.items() if key != "safety"}))
    run.artifact(output)


if __name__ == "__main__":
    main()
