"""Reaching trials through the graph in simulated time.

The code that evaluates logs (`pipeline.reaching.logged_trials`) cuts and measures the trials, so that a run and its bag
give the same result.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from pipeline.deployment.component import NANOSECONDS, Component
from pipeline.deployment.components.autonomous_server import AutonomousServer
from pipeline.deployment.components.control_interface import ControlInterface
from pipeline.deployment.components.controllers import Controller
from pipeline.deployment.components.goals import GoalSolver, compiled_forward, known_configurations
from pipeline.deployment.components.recording import Recorder
from pipeline.deployment.components.termination import TerminalConditions
from pipeline.deployment.components.velocity_estimator import VelocityEstimator
from pipeline.deployment.drivers.bobcat_e10_sim_driver import SimulationDriver
from pipeline.deployment.drivers.machine import LearnedMachine, LearnedStep, Machine, TracedMachine
from pipeline.deployment.messages import GoalOutcome, ReachGoal, Topic
from pipeline.deployment.settings import DeploymentConfig
from pipeline.deployment.transports.simulated_time.delays import Distribution
from pipeline.deployment.transports.simulated_time.graph import SimulatedGraph
from pipeline.logs.tuples import Trajectory
from pipeline.reaching.episodes import Episodes
from pipeline.reaching.logged_trials import LoggedTrial, logged_trials
from pipeline.reaching.task import ReachingTask

SAFETY_FACTOR = 2  # an episode with this multiple of its ticks is given up


@dataclass(frozen=True)
class GraphParts:
    """Common parts of all trials' graphs.

    Attributes:
        task: machine, arm, and the controller's model.
        controller: the controller; every graph has a fresh one.
        solve_goal: maps a pose to a configuration.
        conditions: conditions that end a goal.
        config: section `deployment`.
        action_repeats: ticks per decision.
        maximum_ticks: T_reset.
        step: tick of the learned model in the machine's place.
        new_supervisor: makes each graph's supervisor; None: the graph has none.
    """

    task: ReachingTask
    controller: Controller
    solve_goal: GoalSolver
    conditions: TerminalConditions
    config: DeploymentConfig
    action_repeats: int
    maximum_ticks: int
    step: LearnedStep
    new_supervisor: Callable[[], Component] | None = None

    def with_goals(self, solve_goal: GoalSolver) -> "GraphParts":
        """The same graph with another solver of goals."""
        return replace(self, solve_goal=solve_goal)

    def server(self) -> AutonomousServer:
        """A new server with its own buffers."""
        return AutonomousServer(
            self.task.machine,
            self.task.dynamics.specification,
            self.controller.fresh(),
            self.solve_goal,
            self.conditions,
            self.action_repeats,
            self.maximum_ticks,
        )

    def components(self, machine: Machine, estimator: VelocityEstimator | None = None) -> list[Component]:
        """Components of a graph that drives `machine`."""
        task, config = self.task, self.config
        interface = ControlInterface(task.machine, config.interface)
        driver = SimulationDriver(machine, task.machine.n_joint, config.driver, estimator)
        supervisor = [] if self.new_supervisor is None else [self.new_supervisor()]
        return [self.server(), interface, driver, *supervisor]


def run_episodes(
    parts: GraphParts,
    delays: Mapping[str, Distribution],
    episodes: Episodes,
    progress: Callable[[int], None] = lambda n: None,
    threads: int = 1,
) -> list[LoggedTrial]:
    """Run every episode through a separate graph, with the learned model as the machine (Sim2Sim).

    Args:
        parts: the graph; only its time-out ends the episodes.
        delays: delays of the links.
        episodes: starts and targets.
        progress: called with the number of episodes done.
        threads: number of parallel episodes, which does not change the result. It helps with planners; a policy's
            decisions are too short.

    Returns:
        One trial per episode, of T_reset ticks of the machine since its target was in force.
    """
    parts = parts.with_goals(known_configurations(parts.task.arm, episodes.targets))
    poses = compiled_forward(parts.task.arm)(episodes.targets)
    positions, quaternions = np.asarray(poses.position), np.asarray(poses.quaternion)

    def run(number: int) -> list[LoggedTrial]:
        goal = ReachGoal(number, positions[number], quaternions[number])
        return _run_episode(parts, delays, episodes.starts[number], goal)

    trials = run(0)  # first alone, to compile the common functions
    progress(1)
    with ThreadPoolExecutor(threads) as pool:
        for number, of_episode in enumerate(pool.map(run, range(1, len(episodes.starts))), start=1):
            trials += of_episode
            progress(number + 1)
    return trials


def _run_episode(
    parts: GraphParts, delays: Mapping[str, Distribution], start: np.ndarray, goal: ReachGoal
) -> list[LoggedTrial]:
    machine, recorder = TracedMachine(LearnedMachine(parts.step, start)), Recorder()
    # keyed by the episode, so that a subset gives the same results
    seed = np.random.SeedSequence(parts.config.seed, spawn_key=(goal.goal_id,))
    graph = SimulatedGraph(parts.components(machine), delays, seed, taps=[recorder])
    graph.send(Topic.goal, goal)
    trial = _Trial(recorder, machine, parts.maximum_ticks)
    graph.run(SAFETY_FACTOR * parts.maximum_ticks * machine.period_ns, trial.is_complete)
    return logged_trials([trial.trajectory(str(goal.goal_id))], recorder.target_poses(), parts.maximum_ticks)


@dataclass
class _Trial:
    """An episode in progress."""

    recorder: Recorder
    machine: TracedMachine
    maximum_ticks: int
    rows_before: int | None = None

    def is_complete(self) -> bool:
        """Whether the machine has done all ticks since the target was in force, or the goal has ended."""
        recorder = self.recorder  # called after every event
        if self.rows_before is None:
            self.rows_before = len(recorder.states) if recorder.targets else None
            return False
        if recorder.results and any(
            result.outcome is not GoalOutcome.timed_out for result in recorder.results
        ):
            return True
        return len(recorder.states) - self.rows_before > self.maximum_ticks

    def trajectory(self, name: str) -> Trajectory:
        """The episode's rows; the command of row t acted between rows t and t + 1."""
        states = [state for _, state in self.recorder.states]
        stamp_ns = np.array([state.stamp_ns for state in states], np.int64)
        idle = np.zeros_like(states[0].position)
        return Trajectory(
            name=name,
            t_s=(stamp_ns - stamp_ns[0]) / NANOSECONDS,
            stamp_ns=stamp_ns,
            q=np.array([state.position for state in states]),
            qd=np.array([state.velocity for state in states]),
            a=np.array([*self.machine.commands, idle])[: len(states)],
            is_validation=np.zeros(len(states), bool),
        )
