"""Stage `sim2sim`: a controller drives its model through the asynchronous graph, in simulated time."""

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import jax
from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY, ControlConfiguration
from pipeline.configuration.paths import InputModel, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.control.icem.config import IcemConfig
from pipeline.control.icem.variant import RewardVariant, variant_reward
from pipeline.control.policy import load_policy_of
from pipeline.deployment.components.controllers import (
    Controller,
    ControllerKind,
    IcemController,
    PolicyController,
)
from pipeline.deployment.components.goals import goal_solver
from pipeline.deployment.components.termination import TerminalConditions
from pipeline.deployment.drivers.machine import LearnedStep
from pipeline.deployment.settings import DeploymentConfig
from pipeline.deployment.transports.simulated_time.delays import (
    PLANNING,
    Distribution,
    PlannerEffort,
    delays_of,
    load_delays,
)
from pipeline.deployment.trials import GraphParts, run_episodes
from pipeline.dynamics.evaluation.inference_time import count_parameters
from pipeline.dynamics.model.store import load_model
from pipeline.effects.store import load_dynamics
from pipeline.errors import InputError
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
    icem: IcemConfig = MISSING
    deployment: DeploymentConfig = MISSING
    model: InputModel = MISSING
    policy: InputModel | None = None
    variant: RewardVariant | None = None
    output: OutputFolder = MISSING

    @property
    def kind(self) -> ControllerKind:
        """Of the controller.

        Raises:
            InputError: not exactly one controller is named.
        """
        if (self.policy is None) == (self.variant is None):
            raise InputError(
                "name one controller: policy=FOLDER that `ppo` wrote, or "
                f"variant={'|'.join(RewardVariant)} to plan with iCEM"
            )
        return ControllerKind.icem if self.policy is None else ControllerKind.ppo


@stage(Sim2SimStage)
def main(configuration: Sim2SimStage, run: StageRun) -> None:
    """Run the fixed episodes; write metrics, success-rate matrix, episodes and traces."""
    jax.config.update(
        "jax_cpu_enable_async_dispatch", False
    )  # calls are so short that handing them over costs more
    machine, conditions, output = configuration.machine, configuration.episodes, Path(configuration.output)
    parts = graph_parts(configuration, machine)
    run.inputs(*controller_files(configuration))
    episodes = evaluation_episodes(
        machine, parts.task.arm, conditions, conditions.evaluation_seed, conditions.evaluation_episodes
    )
    if configuration.kind is ControllerKind.icem:
        episodes = episodes.first(configuration.deployment.planner_episodes)
    delays = controller_delays(configuration)
    n_episodes = len(episodes.starts)
    watch = Stopwatch()
    # what a planner computes leaves Python to the other threads; a policy's decisions are too short for that
    threads = len(os.sched_getaffinity(0)) if configuration.kind is ControllerKind.icem else 1
    with progress_bar("sim2sim", total=n_episodes, unit="episode") as bar:
        trials = run_episodes(
            parts, delays, episodes, lambda done: bar.update(done - bar.n) and None, threads
        )
    print(f"sim2sim: {watch.speed(n_episodes * conditions.steps * machine.dt_s)}")
    traces = trial_traces(trials, machine, parts.task.arm)
    metrics = reaching_metrics(traces).as_dict()
    del metrics["average_return"]  # of rewards, which logs of the graph do not hold
    write_evaluation(output, metrics, traces, episodes)
    run.metrics(metrics)
    run.artifact(output, "evaluation")


class Stopwatch:
    """Measures how fast simulated time goes by, compilation and all."""

    def __init__(self) -> None:
        self._start_s, self._start_processor_s = time.perf_counter(), time.process_time()

    def speed(self, simulated_s: float) -> str:
        """What so much of simulated time has taken since the beginning, in words."""
        taken_s = time.perf_counter() - self._start_s
        processor_s = time.process_time() - self._start_processor_s
        return (
            f"{simulated_s:.0f} s of the graph in {taken_s:.0f} s, {simulated_s / taken_s:.0f} x real time "
            f"({processor_s:.0f} s of processor time)"
        )


def graph_parts(configuration: Sim2SimStage, machine: MachineSpecification) -> GraphParts:
    """The graph around a controller and the model that it was learned on, or plans with.

    Raises:
        InputError: no controller is named, or its policy was learned on another model.
    """
    kind, model = configuration.kind, Path(configuration.model)
    reward, repeats = configuration.reward, configuration.control.action_repeats
    if configuration.variant is not None:
        reward = variant_reward(reward, configuration.variant)
    dynamics, parameters = load_dynamics(model)
    arm = load_arm(machine, MACHINE_DIRECTORY)
    task = ReachingTask(machine, arm, dynamics, parameters, reward)
    controller: Controller
    if kind is ControllerKind.icem:
        controller = IcemController(task, configuration.icem, repeats, configuration.deployment.seed)
    else:
        controller = PolicyController(task, load_policy_of(Path(str(configuration.policy)), model))
    return GraphParts(
        task,
        controller,
        goal_solver(machine, arm),
        TerminalConditions(machine, arm, configuration.deployment.termination),
        configuration.deployment,
        repeats,
        configuration.episodes.steps,
        LearnedStep(task),
    )


def controller_files(configuration: Sim2SimStage) -> list[str]:
    """What the model and, where it was learned, the controller are read from."""
    files = [f"{configuration.model}/parameters.msgpack"]
    return files + ([f"{configuration.policy}/policy.msgpack"] if configuration.policy else [])


def controller_delays(configuration: Sim2SimStage) -> Mapping[str, Distribution]:
    """Delays of the graph with this controller; says in one line what of them was not measured."""
    deployment = configuration.deployment
    links, planner = load_delays(Path(deployment.delays))
    if configuration.kind is ControllerKind.icem and planner != planner_effort(configuration):
        links.pop(PLANNING, None)  # another planner's decisions say nothing of this one's
    delays, is_measured = delays_of(links, configuration.kind, deployment.unmeasured_planning_s)
    if not is_measured:
        print(
            f"{deployment.delays} was measured without a planner of this budget and network: a decision is taken to "
            f"last deployment.unmeasured_planning_s = {deployment.unmeasured_planning_s:g} s"
        )
    return delays


def planner_effort(configuration: Sim2SimStage) -> PlannerEffort:
    """What a decision of iCEM costs on this model."""
    model, _ = load_model(Path(configuration.model))
    return PlannerEffort(
        configuration.icem.model_steps(configuration.control.action_repeats), count_parameters(model)
    )


if __name__ == "__main__":
    main()
