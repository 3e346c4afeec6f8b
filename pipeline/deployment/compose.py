"""The graph around one controller: its parts from files and settings, its episodes, its delays."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import jax

from pipeline.control.icem.config import IcemConfig
from pipeline.control.icem.variant import RewardVariant, variant_reward
from pipeline.control.policy import Policy, load_policy_of
from pipeline.deployment.components.controllers import (
    Controller,
    ControllerKind,
    IcemController,
    PolicyController,
)
from pipeline.deployment.components.goals import goal_solver
from pipeline.deployment.components.supervision.control_supervisor import supervise
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
from pipeline.deployment.trials import GraphParts
from pipeline.dynamics.evaluation.inference_time import count_parameters
from pipeline.dynamics.model.store import load_model
from pipeline.effects.store import load_dynamics
from pipeline.errors import InputError
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.machine.kinematics import load_arm
from pipeline.machine.specification import MachineSpecification
from pipeline.reaching.episodes import EpisodesConfig
from pipeline.reaching.reward import RewardConfig
from pipeline.reaching.settings import ReachingSettings


@dataclass(frozen=True, kw_only=True)
class GraphSettings:
    """What a graph is composed of.

    Attributes:
        machine_directory: Folder of the machine's file, from which its robot description is found.
        action_repeats: Ticks of the machine per decision.
        loop_tracker: Of the velocities, where the machine measures none.
        icem: Of a planner; a policy does without.
        model: Folder of the model that the controller was learned on, or plans with.
        policy: Folder of a policy.
        variant: Reward with which iCEM plans; either this or a policy is named.
    """

    machine: MachineSpecification
    machine_directory: Path
    action_repeats: int
    loop_tracker: LoopTrackerConfig
    episodes: EpisodesConfig
    reward: RewardConfig
    icem: IcemConfig
    deployment: DeploymentConfig
    model: str
    policy: str | None = None
    variant: RewardVariant | None = None

    @property
    def kind(self) -> ControllerKind:
        """Of the controller.

        Raises:
            InputError: Not exactly one controller is named.
        """
        if (self.policy is None) == (self.variant is None):
            raise InputError(
                "name one controller: policy=FOLDER that `ppo` or `apg` wrote, or "
                f"variant={'|'.join(RewardVariant)} to plan with iCEM"
            )
        return ControllerKind.icem if self.policy is None else ControllerKind.ppo

    @property
    def reaching(self) -> ReachingSettings:
        """The task but for its model, with the reward that is planned with."""
        arm, reward = load_arm(self.machine, self.machine_directory), self.reward
        if self.variant is not None:
            reward = variant_reward(reward, self.variant)
        return ReachingSettings(self.machine, arm, reward, self.episodes, self.action_repeats)

    @property
    def files(self) -> list[str]:
        """What the model and, where it was learned, the controller are read from."""
        files = [f"{self.model}/parameters.msgpack"]
        return files + ([f"{self.policy}/policy.msgpack"] if self.policy else [])


def dispatch_synchronously() -> None:
    """Have JAX compute in the calling thread: the graph's calls are so short that handing them over costs more."""
    jax.config.update("jax_cpu_enable_async_dispatch", False)


def graph_parts(settings: GraphSettings, policy: Policy | None = None) -> GraphParts:
    """Load the model and the controller.

    Args:
        settings: What the graph is composed of.
        policy: Controller in place of the one that the settings name, learned on any model of the same window.

    Raises:
        InputError: No controller is named, or its policy was learned on another model.
    """
    kind, reaching, deployment = settings.kind, settings.reaching, settings.deployment
    task = reaching.task(*load_dynamics(Path(settings.model)))
    controller: Controller
    if kind is ControllerKind.icem:
        controller = IcemController(task, settings.icem, settings.action_repeats, deployment.seed)
    else:
        policy = policy or load_policy_of(
            Path(str(settings.policy)), Path(settings.model), settings.machine.name
        )
        controller = PolicyController(task, policy)
    new_supervisor = partial(supervise, task.machine, deployment, settings.machine_directory, settings.model)
    return GraphParts(
        task,
        controller,
        goal_solver(task.machine, task.arm),
        TerminalConditions(task.machine, task.arm, deployment.termination),
        deployment,
        settings.action_repeats,
        settings.episodes.steps,
        LearnedStep(task),
        new_supervisor if deployment.supervisor.rules or deployment.interface.supervised else None,
    )


def controller_delays(settings: GraphSettings) -> Mapping[str, Distribution]:
    """Delays of the graph with this controller; says in one line what of them was not measured."""
    deployment = settings.deployment
    here, of_repository = Path(deployment.delays), settings.machine_directory.parents[1] / deployment.delays
    links, planner = load_delays(here if here.exists() or not of_repository.exists() else of_repository)
    if settings.kind is ControllerKind.icem and planner != planner_effort(settings):
        links.pop(PLANNING, None)  # another planner's decisions say nothing of this one's
    delays, is_measured = delays_of(links, settings.kind, deployment.unmeasured_planning_s)
    if not is_measured:
        print(
            f"{deployment.delays} was measured without a planner of this budget and network: a decision is taken to "
            f"last deployment.unmeasured_planning_s = {deployment.unmeasured_planning_s:g} s"
        )
    return delays


def planner_effort(settings: GraphSettings) -> PlannerEffort:
    """What a decision of iCEM costs on this model."""
    model, _ = load_model(Path(settings.model))
    return PlannerEffort(settings.icem.model_steps(settings.action_repeats), count_parameters(model))
