"""Stage `ppo`: a reaching policy is learned on an identified model with PPO and discretised proto-actions."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY, ControlConfiguration
from pipeline.configuration.paths import CheckpointFolder, InputModel, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.control.checkpoint import is_checkpoint
from pipeline.control.curve import CurvePoint
from pipeline.control.ppo import PPOConfig
from pipeline.control.train_policy import train_policy
from pipeline.files.checkpoint_cleanup import remove_checkpoints
from pipeline.machine.kinematics import load_arm
from pipeline.reaching.episodes import EpisodesConfig
from pipeline.reaching.reward import RewardConfig
from pipeline.tracking import StageRun, progress_bar


@dataclass
class PPOStage(PipelineConfiguration):
    """Keys of `conf/ppo.yaml`."""

    control: ControlConfiguration = MISSING
    episodes: EpisodesConfig = MISSING
    reward: RewardConfig = MISSING
    ppo: PPOConfig = MISSING
    model: InputModel = MISSING
    seed: int = MISSING
    checkpoints: CheckpointFolder | None = None
    output: OutputFolder = MISSING


@stage(PPOStage)
def main(configuration: PPOStage, run: StageRun) -> None:
    """Train one policy and write its folder."""
    machine, output, seed = configuration.machine, Path(configuration.output), configuration.seed
    checkpoints = Path(configuration.checkpoints) if configuration.checkpoints else None
    arm = load_arm(machine, MACHINE_DIRECTORY)
    run.inputs(f"{configuration.model}/parameters.msgpack")
    with progress_bar(f"ppo seed {seed}", configuration.ppo.training_steps, "step") as bar:

        def progress(point: CurvePoint, training_steps: int) -> None:
            metrics = point.metrics.as_dict()
            shown = {key: f"{metrics[key]:.2f}" for key in ("average_return", "sr_012_008")}
            bar.set_postfix(shown, refresh=False)
            bar.total = training_steps
            bar.reach(point.steps)
            run.metrics({f"curve.{key}": value for key, value in metrics.items()}, step=point.steps)

        trained = train_policy(
            Path(configuration.model),
            machine,
            arm,
            configuration.ppo,
            configuration.episodes,
            configuration.reward,
            configuration.control.action_repeats,
            seed,
            progress,
            checkpoints,
        )
    trained.save(output)
    run.metrics(trained.metrics)
    run.artifact(output, "policy")
    if checkpoints:  # a finished run must not be taken up again by changed code
        remove_checkpoints(checkpoints, is_checkpoint)


if __name__ == "__main__":
    main()
