"""Reaching trials through the graph in simulated time, and what they were judged by.

The trials are cut and measured by the code that evaluates logs (`pipeline.reaching.logged_trials`): what the graph
ran and what a bag of it holds are evaluated alike.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from pipeline.deployment.autonomous_server import AutonomousServer
from pipeline.deployment.bobcat_e10_sim_driver import SimulationDriver
from pipeline.deployment.component import NANOSECONDS, Component
from pipeline.deployment.control_interface import ControlInterface
from pipeline.deployment.controllers import Controller
from pipeline.deployment.goals import GoalSolver, compiled_forward, known_configurations
from pipeline.deployment.machine import LearnedMachine, LearnedStep, Machine, TracedMachine
from pipeline.deployment.messages import Outcome, ReachGoal, Topic
from pipeline.deployment.recording import Recorder
from pipeline.deployment.settings import DeploymentConfig
from pipeline.deployment.simulated_time.delays import Distribution
from pipeline.deployment.simulated_time.graph import SimulatedGraph
from pipeline.deployment.termination import TerminalConditions
from pipeline.deployment.velocity_estimator import VelocityEstimator
from pipeline.logs.tuples import Trajectory
from pipeline.reaching.episodes import Episodes
from pipeline.reaching.logged_trials import LoggedTrial, logged_trials
from pipeline.reaching.task import ReachingTask

SAFETY_FACTOR = 2  # an episode that takes so many times its ticks would never end


@dataclass(frozen=True)
class GraphParts:
    """What the graphs of all trials share.

    Attributes:
        task: machine, arm, and the model that the controller belongs to.
        controller: decides; one trial at a time.
        solve_goal: from a pose to a configuration.
        conditions: that end a goal.
        config: section `deployment`.
        action_repeats: ticks per decision.
        maximum_ticks: T_reset.
        step: of the learned model in the machine's place.
    """

    task: ReachingTask
    controller: Controller
    solve_goal: GoalSolver
    conditions: TerminalConditions
    config: DeploymentConfig
    action_repeats: int
    maximum_ticks: int
    step: LearnedStep

    def with_goals(self, solve_goal: GoalSolver) -> "GraphParts":
        """The same graph with another way from poses to configurations."""
        return replace(self, solve_goal=solve_goal)

    def server(self) -> AutonomousServer:
        """A server of its own buffers."""
        return AutonomousServer(
            self.task.machine,
            self.task.dynamics.specification,
            self.controller,
            self.solve_goal,
            self.conditions,
            self.action_repeats,
            self.maximum_ticks,
        )

    def components(
        self, machine: Machine, estimator: VelocityEstimator | None = None, *further: Component
    ) -> list[Component]:
        """A graph that drives `machine`, with `further` components (a supervisor) in it."""
        task, config = self.task, self.config
        interface = ControlInterface(task.machine, config.interface)
        driver = SimulationDriver(machine, task.machine.n_joint, config.driver, estimator)
        return [self.server(), interface, driver, *further]


def run_episodes(
    parts: GraphParts,
    delays: Mapping[str, Distribution],
    episodes: Episodes,
    progress: Callable[[int], None] = lambda n: None,
) -> list[LoggedTrial]:
    """Run every episode through a graph of its own, the learned model in place of the machine (Sim2Sim).

    Args:
        parts: the graph; its time-out ends the episodes, whatever its conditions.
        delays: of the links.
        episodes: starts and targets.
        progress: called with the number of episodes done.

    Returns:
        One trial per episode, of T_reset ticks of the machine from when the target was in force.
    """
    parts = parts.with_goals(known_configurations(parts.task.arm, episodes.targets))
    poses = compiled_forward(parts.task.arm)(episodes.targets)
    positions, quaternions = np.asarray(poses.position), np.asarray(poses.quaternion)
    trials = []
    for number, start in enumerate(episodes.starts):
        machine, recorder = TracedMachine(LearnedMachine(parts.step, start)), Recorder()
        # keyed by the episode, so that a part of the episodes runs as it does among all
        seed = np.random.SeedSequence(parts.config.seed, spawn_key=(number,))
        graph = SimulatedGraph(parts.components(machine), delays, seed, taps=[recorder])
        graph.send(Topic.goal, ReachGoal(number, positions[number], quaternions[number]))
        trial = _Trial(recorder, machine, parts.maximum_ticks)
        graph.run(SAFETY_FACTOR * parts.maximum_ticks * machine.period_ns, trial.is_complete)
        trials += logged_trials([trial.trajectory(str(number))], recorder.target_poses(), parts.maximum_ticks)
        progress(number + 1)
    return trials


@dataclass
class _Trial:
    """An episode in progress."""

    recorder: Recorder
    machine: TracedMachine
    maximum_ticks: int
    rows_before: int | None = None

    def is_complete(self) -> bool:
        """Whether the machine has gone all its ticks since the target was in force, or the goal ended before."""
        if self.rows_before is None:
            self.rows_before = len(self.recorder.states) if self.recorder.targets else None
            return False
        ended = [result for result in self.recorder.results if result.outcome is not Outcome.timed_out]
        return bool(ended) or len(self.recorder.states) - self.rows_before > self.maximum_ticks

    def trajectory(self, name: str) -> Trajectory:
        """The episode's rows: row t's command is what acted between rows t and t + 1."""
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
