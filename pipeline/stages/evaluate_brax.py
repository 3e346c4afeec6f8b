"""Stage `evaluate_brax`: a policy is tried on the fixed episodes, on the model that it was learned on."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY, ControlConfiguration
from pipeline.configuration.paths import InputModel, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.control.evaluate import evaluate_policy
from pipeline.control.policy import load_policy_of
from pipeline.effects.store import load_dynamics
from pipeline.machine.kinematics import load_arm
from pipeline.reaching.episodes import EpisodesConfig, evaluation_episodes
from pipeline.reaching.evaluation_files import write_evaluation
from pipeline.reaching.metrics import reaching_metrics
from pipeline.reaching.reward import RewardConfig
from pipeline.reaching.task import ReachingTask
from pipeline.tracking import StageRun


@dataclass
class EvaluateBraxStage(PipelineConfiguration):
    """Keys of `conf/evaluate_brax.yaml`."""

    control: ControlConfiguration = MISSING
    episodes: EpisodesConfig = MISSING
    reward: RewardConfig = MISSING
    model: InputModel = MISSING
    policy: InputModel = MISSING
    output: OutputFolder = MISSING


@stage(EvaluateBraxStage)
def main(configuration: EvaluateBraxStage, run: StageRun) -> None:
    """Evaluate one policy; write metrics, success-rate matrix, episodes and traces."""
    machine, conditions, output = configuration.machine, configuration.episodes, Path(configuration.output)
    arm = load_arm(machine, MACHINE_DIRECTORY)
    dynamics, parameters = load_dynamics(Path(configuration.model))
    policy = load_policy_of(Path(configuration.policy), Path(configuration.model))
    run.inputs(f"{configuration.model}/parameters.msgpack", f"{configuration.policy}/policy.msgpack")
    task = ReachingTask(machine, arm, dynamics, parameters, configuration.reward)
    episodes = evaluation_episodes(
        machine, arm, conditions, conditions.evaluation_seed, conditions.evaluation_episodes
    )
    traces = evaluate_policy(policy, task, configuration.control.action_repeats, conditions.steps, episodes)
    metrics = reaching_metrics(traces).as_dict()
    write_evaluation(output, metrics, traces, episodes)
    # The reward that a policy was learned with is the full one; iCEM's runs have both returns.
    run.metrics({**metrics, "average_return_full_reward": metrics["average_return"]})
    run.artifact(output, "evaluation")


if __name__ == "__main__":
    main()
