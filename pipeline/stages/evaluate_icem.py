"""Stage `evaluate_icem`: iCEM plans through the fixed episodes, on the model that it plans with."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import CheckpointFolder
from pipeline.configuration.reaching import ReachingKeys
from pipeline.configuration.stage import stage
from pipeline.control.chunks import is_chunk
from pipeline.control.evaluate_planner import evaluate_planner
from pipeline.control.icem.config import IcemConfig
from pipeline.control.icem.variant import RewardVariant
from pipeline.files.checkpoint_cleanup import remove_checkpoints
from pipeline.reaching.evaluation_files import write_evaluation
from pipeline.tracking import StageRun, flatten_metrics, progress_bar


@dataclass
class EvaluateIcemStage(ReachingKeys):
    """Keys of `conf/evaluate_icem.yaml`."""

    icem: IcemConfig = MISSING
    variant: RewardVariant = MISSING
    seed: int = MISSING
    checkpoints: CheckpointFolder | None = None


@stage(EvaluateIcemStage)
def main(configuration: EvaluateIcemStage, run: StageRun) -> None:
    """Evaluate one variant; write metrics, success-rate matrix, episodes and traces as `evaluate_brax` does."""
    reaching, model, icem = configuration.reaching, Path(configuration.model), configuration.icem
    output, seed, variant = Path(configuration.output), configuration.seed, configuration.variant
    checkpoints = Path(configuration.checkpoints) if configuration.checkpoints else None
    run.inputs(model / "parameters.msgpack")
    episodes = reaching.fixed_episodes(icem.first_episodes)
    with progress_bar(f"{variant} seed {seed}", len(episodes.starts), "episode") as bar:
        traces, metrics = evaluate_planner(
            model, reaching, icem, variant, episodes, seed, lambda n: bar.update(n) and None, checkpoints
        )
    write_evaluation(output, metrics, traces, episodes)
    run.metrics(flatten_metrics(metrics))
    run.artifact(output, "evaluation")
    remove_checkpoints(checkpoints, is_chunk)


if __name__ == "__main__":
    main()
