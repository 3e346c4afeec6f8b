"""Stage `ppo`: a reaching policy is learned on an identified model with PPO and discretised proto-actions."""

import json
from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY, ControlConfiguration
from pipeline.configuration.paths import CheckpointFolder, InputModel, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.control.checkpoint import is_checkpoint
from pipeline.control.curve import CurvePoint, write_curve
from pipeline.control.policy import save_policy
from pipeline.control.ppo import PPOConfig, train
from pipeline.effects.store import dynamics_fingerprint, load_dynamics
from pipeline.files.checkpoint_cleanup import remove_checkpoints
from pipeline.machine.kinematics import load_arm
from pipeline.reaching.environment import ReachingEnvironment
from pipeline.reaching.episodes import EpisodesConfig, evaluation_episodes, learning_poses
from pipeline.reaching.reward import RewardConfig
from pipeline.reaching.task import ReachingTask
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
    machine, episodes, output = configuration.machine, configuration.episodes, Path(configuration.output)
    arm = load_arm(machine, MACHINE_DIRECTORY)
    dynamics, parameters = load_dynamics(Path(configuration.model))
    run.inputs(f"{configuration.model}/parameters.msgpack")
    settings = configuration.ppo.for_model(dynamics.specification)
    environment = ReachingEnvironment(
        ReachingTask(machine, arm, dynamics, parameters, configuration.reward),
        learning_poses(machine, arm, episodes, configuration.seed),
        configuration.control.action_repeats,
        episodes.steps,
    )
    # The curve is measured on episodes of its own: those of the evaluation decide nothing here.
    curve_episodes = evaluation_episodes(machine, arm, episodes, episodes.curve_seed, settings.curve_episodes)
    with progress_bar(f"ppo seed {configuration.seed}", settings.training_steps, "step") as bar:

        def progress(point: CurvePoint) -> None:
            metrics = point.metrics.as_dict()
            bar.set_postfix(
                {key: f"{metrics[key]:.2f}" for key in ("average_return", "sr_012_008")}, refresh=False
            )
            bar.update(min(point.steps, settings.training_steps) - bar.n)
            run.metrics({f"curve.{key}": value for key, value in metrics.items()}, step=point.steps)

        result = train(
            environment,
            settings,
            configuration.seed,
            curve_episodes,
            progress,
            Path(configuration.checkpoints) if configuration.checkpoints else None,
        )
    lineage = {
        "seed": configuration.seed,
        "steps": result.policy_steps,
        "machine": machine.name,
        "model": dynamics_fingerprint(Path(configuration.model)),
        "action_repeats": configuration.control.action_repeats,
    }
    save_policy(output, result.policy, lineage)
    write_curve(output / "curves.csv", result.curve)
    kept = next(point for point in result.curve if point.steps == result.policy_steps)
    metrics = {"steps": kept.steps, **kept.metrics.as_dict()}
    (output / "metrics.json").write_text(json.dumps(metrics, indent=1) + "\n")
    run.metrics(metrics)
    run.artifact(output, "policy")
    if configuration.checkpoints:  # a finished run must not be taken up again by changed code
        remove_checkpoints(Path(configuration.checkpoints), is_checkpoint)


if __name__ == "__main__":
    main()
