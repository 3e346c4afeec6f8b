"""Stage `ppo`: a reaching policy is learned on an identified model with PPO and discretised proto-actions."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import CheckpointFolder
from pipeline.configuration.reaching import ReachingKeys
from pipeline.configuration.stage import stage
from pipeline.control.checkpoint import is_checkpoint
from pipeline.control.curve import CurvePoint
from pipeline.control.ppo import PPOConfig
from pipeline.control.train_policy import train_policy
from pipeline.files.checkpoint_cleanup import remove_checkpoints
from pipeline.tracking import StageRun, progress_bar


@dataclass
class PPOStage(ReachingKeys):
    """Keys of `conf/ppo.yaml`."""

    ppo: PPOConfig = MISSING
    seed: int = MISSING
    checkpoints: CheckpointFolder | None = None


@stage(PPOStage)
def main(configuration: PPOStage, run: StageRun) -> None:
    """Train one policy and write its folder."""
    output, seed = Path(configuration.output), configuration.seed
    checkpoints = Path(configuration.checkpoints) if configuration.checkpoints else None
    run.inputs(f"{configuration.model}/parameters.msgpack")
    with progress_bar(f"ppo seed {seed}", configuration.ppo.training_steps, "step") as bar:

        def progress(point: CurvePoint, training_steps: int) -> None:
            metrics = point.metrics.as_dict()
            shown = {key: f"{metrics[key]:.2f}" for key in ("average_return", "sr_012_008")}
            bar.set_postfix(shown, refresh=False)
            bar.total = training_steps
            bar.reach(point.steps)
            run.metrics({f"curve.{key}": value for key, value in metrics.items()}, step=point.steps)

        model, reaching = Path(configuration.model), configuration.reaching
        trained = train_policy(model, reaching, configuration.ppo, seed, progress, checkpoints)
    trained.save(output)
    run.metrics(trained.metrics)
    run.artifact(output, "policy")
    if checkpoints:  # a finished run must not be taken up again by changed code
        remove_checkpoints(checkpoints, is_checkpoint)


if __name__ == "__main__":
    main()
