"""Stage `evaluate_brax`: a policy is tried on the fixed episodes, on the model that it was learned on."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from omegaconf import MISSING

from pipeline.configuration import MACHINE_DIRECTORY, ControlConfiguration, PipelineConfiguration, stage
from pipeline.control.evaluate import evaluate_policy
from pipeline.control.policy import load_policy
from pipeline.effects.store import dynamics_fingerprint, load_dynamics
from pipeline.errors import InputError
from pipeline.machine.kinematics import load_arm
from pipeline.reaching.episodes import EpisodesConfig, evaluation_episodes, save_episodes
from pipeline.reaching.metrics import reaching_metrics, success_rate_matrix
from pipeline.reaching.reward import RewardConfig
from pipeline.reaching.task import ReachingTask
from pipeline.tracking import StageRun


@dataclass
class EvaluateBraxStage(PipelineConfiguration):
    """Keys of `conf/evaluate_brax.yaml`."""

    control: ControlConfiguration = MISSING
    episodes: EpisodesConfig = MISSING
    reward: RewardConfig = MISSING
    model: str = MISSING
    policy: str = MISSING
    output: str = MISSING


@stage(EvaluateBraxStage)
def main(configuration: EvaluateBraxStage, run: StageRun) -> None:
    """Evaluate one policy; write metrics, success-rate matrix, episodes and traces."""
    machine, conditions, output = configuration.machine, configuration.episodes, Path(configuration.output)
    arm = load_arm(machine, MACHINE_DIRECTORY)
    dynamics, parameters = load_dynamics(Path(configuration.model))
    policy, lineage = load_policy(Path(configuration.policy))
    if lineage.get("model") != dynamics_fingerprint(Path(configuration.model)):
        raise InputError(
            f"{configuration.policy}: was not learned on {configuration.model}; name the model that it was learned on"
        )
    run.inputs(f"{configuration.model}/parameters.msgpack", f"{configuration.policy}/policy.msgpack")
    task = ReachingTask(machine, arm, dynamics, parameters, configuration.reward)
    episodes = evaluation_episodes(
        machine, arm, conditions, conditions.evaluation_seed, conditions.evaluation_episodes
    )
    traces = evaluate_policy(policy, task, configuration.control.action_repeats, conditions.steps, episodes)
    metrics = reaching_metrics(traces).as_dict()
    output.mkdir(parents=True, exist_ok=True)
    (output / "metrics.json").write_text(json.dumps(metrics, indent=1) + "\n")
    np.savetxt(output / "success_rates.csv", success_rate_matrix(traces), fmt="%.4f", delimiter=",")
    save_episodes(output / "episodes.npz", episodes)
    np.savez_compressed(output / "traces.npz", **traces._asdict())
    run.metrics(metrics)
    run.artifact(output, "evaluation")


if __name__ == "__main__":
    main()
