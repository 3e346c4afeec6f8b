"""Stage `evaluate_icem`: iCEM plans through the fixed episodes, on the model that it plans with."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY, ControlConfiguration
from pipeline.configuration.paths import CheckpointFolder, InputModel, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.control.chunks import is_chunk
from pipeline.control.evaluate_planner import evaluate_planner
from pipeline.control.icem.config import IcemConfig
from pipeline.control.icem.variant import RewardVariant
from pipeline.files.checkpoint_cleanup import remove_checkpoints
from pipeline.machine.kinematics import load_arm
from pipeline.reaching.episodes import EpisodesConfig, evaluation_episodes
from pipeline.reaching.evaluation_files import write_evaluation
from pipeline.reaching.reward import RewardConfig
from pipeline.tracking import StageRun, flatten_metrics, progress_bar


@dataclass
class EvaluateIcemStage(PipelineConfiguration):
    """Keys of `conf/evaluate_icem.yaml`."""

    control: ControlConfiguration = MISSING
    episodes: EpisodesConfig = MISSING
    reward: RewardConfig = MISSING
    icem: IcemConfig = MISSING
    model: InputModel = MISSING
    variant: RewardVariant = MISSING
    seed: int = MISSING
    checkpoints: CheckpointFolder | None = None
    output: OutputFolder = MISSING


@stage(EvaluateIcemStage)
def main(configuration: EvaluateIcemStage, run: StageRun) -> None:
    """Evaluate one variant; write metrics, success-rate matrix, episodes and traces as `evaluate_brax` does."""
    machine, conditions, icem = configuration.machine, configuration.episodes, configuration.icem
    output, seed, variant = Path(configuration.output), configuration.seed, configuration.variant
    checkpoints = Path(configuration.checkpoints) if configuration.checkpoints else None
    arm = load_arm(machine, MACHINE_DIRECTORY)
    run.inputs(f"{configuration.model}/parameters.msgpack")
    episodes = evaluation_episodes(
        machine, arm, conditions, conditions.evaluation_seed, conditions.evaluation_episodes
    ).first(icem.first_episodes or conditions.evaluation_episodes)
    with progress_bar(f"{variant} seed {seed}", len(episodes.starts), "episode") as bar:
        traces, metrics = evaluate_planner(
            Path(configuration.model),
            machine,
            arm,
            icem,
            variant,
            configuration.reward,
            episodes,
            conditions.steps,
            configuration.control.action_repeats,
            seed,
            lambda n: bar.update(n) and None,
            checkpoints,
        )
    write_evaluation(output, metrics, traces, episodes)
    run.metrics(flatten_metrics(metrics))
    run.artifact(output, "evaluation")
    if checkpoints:  # a finished evaluation must not be taken up again by changed code
        remove_checkpoints(checkpoints, is_chunk)


if __name__ == "__main__":
    main()
