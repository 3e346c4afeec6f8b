"""Stage `sim2sim`: a policy drives its model through the asynchronous graph, in simulated time (paper, "Sim2Sim")."""

import time
from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration import MACHINE_DIRECTORY, ControlConfiguration, PipelineConfiguration, stage
from pipeline.control.policy import load_policy_of
from pipeline.deployment.controllers import PolicyController
from pipeline.deployment.goals import goal_solver
from pipeline.deployment.machine import LearnedStep
from pipeline.deployment.settings import DeploymentConfig
from pipeline.deployment.simulated_time.delays import load_delays
from pipeline.deployment.termination import TerminalConditions
from pipeline.deployment.trials import GraphParts, run_episodes
from pipeline.effects.store import load_dynamics
from pipeline.machine.kinematics import load_arm
from pipeline.machine.specification import MachineSpecification
from pipeline.reaching.episodes import EpisodesConfig, evaluation_episodes
from pipeline.reaching.evaluation_files import write_evaluation
from pipeline.reaching.logged_trials import trial_traces
from pipeline.reaching.metrics import reaching_metrics
from pipeline.reaching.reward import RewardConfig
from pipeline.reaching.task import ReachingTask
from pipeline.tracking import StageRun, progress_bar


@dataclass
class Sim2SimStage(PipelineConfiguration):
    """Keys of `conf/sim2sim.yaml`."""

    control: ControlConfiguration = MISSING
    episodes: EpisodesConfig = MISSING
    reward: RewardConfig = MISSING
    deployment: DeploymentConfig = MISSING
    model: str = MISSING
    policy: str = MISSING
    output: str = MISSING


@stage(Sim2SimStage)
def main(configuration: Sim2SimStage, run: StageRun) -> None:
    """Run the fixed episodes; write metrics, success-rate matrix, episodes and traces."""
    machine, conditions, output = configuration.machine, configuration.episodes, Path(configuration.output)
    parts = policy_parts(configuration, machine)
    run.inputs(f"{configuration.model}/parameters.msgpack", f"{configuration.policy}/policy.msgpack")
    episodes = evaluation_episodes(
        machine, parts.task.arm, conditions, conditions.evaluation_seed, conditions.evaluation_episodes
    )
    delays = load_delays(Path(configuration.deployment.delays))
    n_episodes = len(episodes.starts)
    started_s, started_cpu_s = time.perf_counter(), time.process_time()
    with progress_bar("sim2sim", total=n_episodes, unit="episode") as bar:
        trials = run_episodes(parts, delays, episodes, lambda done: bar.update(done - bar.n))
    taken_s, cpu_s = time.perf_counter() - started_s, time.process_time() - started_cpu_s
    simulated_s = n_episodes * conditions.steps * machine.dt_s
    print(
        f"sim2sim: {simulated_s:.0f} s of the graph in {taken_s:.0f} s, {simulated_s / taken_s:.0f} x real time "
        f"({cpu_s:.0f} s of processor time)"
    )
    traces = trial_traces(trials, machine, parts.task.arm)
    metrics = reaching_metrics(traces).as_dict()
    del metrics["average_return"]  # of rewards, which logs of the graph do not hold
    write_evaluation(output, metrics, traces, episodes)
    run.metrics(metrics)
    run.artifact(output, "evaluation")


def policy_parts(configuration: Sim2SimStage, machine: MachineSpecification) -> GraphParts:
    """The graph around a policy and the model that it was learned on.

    Raises:
        InputError: the policy was learned on another model.
    """
    dynamics, parameters = load_dynamics(Path(configuration.model))
    policy = load_policy_of(Path(configuration.policy), Path(configuration.model))
    arm = load_arm(machine, MACHINE_DIRECTORY)
    task = ReachingTask(machine, arm, dynamics, parameters, configuration.reward)
    return GraphParts(
        task,
        PolicyController(task, policy),
        goal_solver(machine, arm),
        TerminalConditions(machine, arm, configuration.deployment.termination),
        configuration.deployment,
        configuration.control.action_repeats,
        configuration.episodes.steps,
        LearnedStep(task),
    )


if __name__ == "__main__":
    main()
