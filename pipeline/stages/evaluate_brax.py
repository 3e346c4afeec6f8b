"""Stage `evaluate_brax`: a policy is tried on the fixed episodes, on the model that it was learned on."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import InputModel
from pipeline.configuration.reaching import ReachingKeys
from pipeline.configuration.stage import stage
from pipeline.control.evaluate import evaluate_policy
from pipeline.control.policy import load_policy_of
from pipeline.effects.store import load_dynamics
from pipeline.reaching.evaluation_files import write_evaluation
from pipeline.reaching.metrics import reaching_metrics
from pipeline.tracking import StageRun


@dataclass
class EvaluateBraxStage(ReachingKeys):
    """Keys of `conf/evaluate_brax.yaml`."""

    policy: InputModel = MISSING


@stage(EvaluateBraxStage)
def main(configuration: EvaluateBraxStage, run: StageRun) -> None:
    """Evaluate one policy; write metrics, success-rate matrix, episodes and traces."""
    reaching, model, output = configuration.reaching, configuration.model, Path(configuration.output)
    dynamics, parameters = load_dynamics(Path(model))
    policy = load_policy_of(Path(configuration.policy), Path(model), reaching.machine.name)
    run.inputs(f"{model}/parameters.msgpack", f"{configuration.policy}/policy.msgpack")
    task, episodes = reaching.task(dynamics, parameters), reaching.fixed_episodes()
    traces = evaluate_policy(policy, task, reaching.action_repeats, reaching.episodes.steps, episodes)
    metrics = reaching_metrics(traces, task.arm.surfaces).as_dict()
    write_evaluation(output, metrics, traces, episodes)
    # The reward that a policy was learned with is the full one; iCEM's runs have both returns.
    run.metrics({**metrics, "average_return_full_reward": metrics["average_return"]})
    run.artifact(output, "evaluation")


if __name__ == "__main__":
    main()
