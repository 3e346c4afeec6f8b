"""What the stages that train a policy share; each names its method and its section of the profile."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import CheckpointFolder
from pipeline.configuration.reaching import ReachingKeys
from pipeline.control.checkpoint import is_checkpoint
from pipeline.control.curve import CurvePoint
from pipeline.control.train_policy import S, Train, train_policy
from pipeline.files.checkpoint_cleanup import remove_checkpoints
from pipeline.tracking import StageRun, progress_bar


@dataclass
class TrainingKeys(ReachingKeys):
    """Keys of a stage that trains a policy on a model."""

    seed: int = MISSING
    checkpoints: CheckpointFolder | None = None


def run_training(name: str, configuration: TrainingKeys, train: Train[S], config: S, run: StageRun) -> None:
    """Train one policy and write its folder, with a progress bar, tracked metrics and checkpoints."""
    output, seed = Path(configuration.output), configuration.seed
    checkpoints = Path(configuration.checkpoints) if configuration.checkpoints else None
    run.inputs(f"{configuration.model}/parameters.msgpack")
    with progress_bar(f"{name} seed {seed}", config.training_steps, "step") as bar:

        def progress(point: CurvePoint) -> None:
            metrics = point.metrics.as_dict()
            shown = {key: f"{metrics[key]:.2f}" for key in ("average_return", "sr_012_008")}
            bar.reach(point.steps, **shown)
            run.metrics({f"curve.{key}": value for key, value in metrics.items()}, step=point.steps)

        model, reaching = Path(configuration.model), configuration.reaching
        trained = train_policy(model, reaching, train, config, seed, progress, checkpoints)
    trained.save(output)
    run.metrics(trained.metrics)
    run.artifact(output, "policy")
    remove_checkpoints(checkpoints, is_checkpoint)
