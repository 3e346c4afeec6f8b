"""Controllers with one interface, from the autonomous server's state to a command: PPO's policies, and iCEM."""

import copy
import enum
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.control.icem.config import IcemConfig
from pipeline.control.icem.controller import icem_planner
from pipeline.control.icem.planner import PlannerState
from pipeline.control.policy import Policy
from pipeline.deployment.components.state_buffers import Observer
from pipeline.dynamics.model.features import History
from pipeline.reaching.task import Goal, ReachingTask, TaskState


class ControllerKind(enum.StrEnum):
    """Kinds of controllers, which differ in decision time."""

    ppo = "ppo"
    icem = "icem"


class ControllerState(NamedTuple):
    """Input of a decision; NumPy arrays, float32.

    Attributes:
        motion: the window's rows, (k+1, n_joint), oldest first: velocities or positions, as the model requires.
        commands: the commands before this decision, (k+1, n_joint), oldest first.
        q: present configuration, (n_joint,).
        target: configuration of the target pose, (n_joint,).
        history: the model's, where it holds more than the window: from the controller's `observer`.
    """

    motion: np.ndarray
    commands: np.ndarray
    q: np.ndarray
    target: np.ndarray
    history: Any = None


class Controller(Protocol):
    """A controller; called every few ticks, and for one machine at a time.

    Attributes:
        observer: what estimates the history of its model; None: the windows are all of it that decides.
    """

    observer: Observer | None

    def begin(self, goal_id: int) -> None:
        """Begin a goal: forget the last plan. Random numbers depend on the goal's number alone."""

    def decide(self, state: ControllerState) -> np.ndarray:
        """The command from now on, (n_joint,); not finite if the controller fails."""

    def fresh(self) -> "Controller":
        """A copy for another machine, which shares compiled functions."""


class PolicyController:
    """A learned policy (PPO); deterministic."""

    observer: Observer | None = None  # a policy sees what is measured

    def __init__(self, task: ReachingTask, policy: Policy) -> None:
        self._policy = policy

        def command(policy: Policy, state: ControllerState) -> tuple[jax.Array, jax.Array]:
            proto_action = policy.act(task.observe(measured(task, state)))
            return proto_action, task.command(proto_action)

        self._command = jax.jit(command)

    def begin(self, goal_id: int) -> None:
        """No effect: a policy is stateless."""

    def decide(self, state: ControllerState) -> np.ndarray:
        """The policy's command; a non-finite proto-action is returned, because discretisation would hide it."""
        proto_action, command = jax.device_get(self._command(self._policy, state))
        return command if np.isfinite(proto_action).all() else proto_action

    def fresh(self) -> "PolicyController":
        """The same object: a policy is stateless."""
        return self


class IcemController:
    """Model predictive control (iCEM): every decision replans from the previous plan, shifted in time."""

    def __init__(self, task: ReachingTask, config: IcemConfig, action_repeats: int, seed: int) -> None:
        """A planner without a goal.

        Args:
            task: task with the planning model; its reward is the planner's.
            config: budget and ingredients.
            action_repeats: ticks per decision.
            seed: seed of the samples, combined with the goal's number.

        Raises:
            InputError: the horizon is not longer than a decision.
        """
        hidden = task.dynamics.has_hidden_state
        self.observer = Observer(task.dynamics, task.parameters) if hidden else None
        planner = icem_planner(task, config, action_repeats)

        def decide(plan: PlannerState, state: ControllerState) -> tuple[PlannerState, jax.Array]:
            return planner.decide(plan, measured(task, state))

        self._begin: Callable[[jax.Array], PlannerState] = jax.jit(planner.begin)
        self._decide = jax.jit(decide)
        self._key = jax.random.key(seed)
        self._plan: PlannerState | None = None

    def begin(self, goal_id: int) -> None:
        """Forget the plan."""
        self._plan = self._begin(jax.random.fold_in(self._key, goal_id))

    def decide(self, state: ControllerState) -> np.ndarray:
        """The first command of a new plan."""
        if self._plan is None:
            self.begin(0)
        if not all(np.isfinite(values).all() for values in jax.tree.leaves(state)):
            return np.full_like(state.q, np.nan)  # all plans have the same return: no decision
        self._plan, command = self._decide(self._plan, state)
        return np.asarray(command)

    def fresh(self) -> "IcemController":
        """A planner without a goal, which shares compiled functions."""
        other = copy.copy(self)
        other._plan = None
        return other


def measured(task: ReachingTask, state: ControllerState) -> TaskState:
    """The task's state from measurements: x̃ from the buffers, with the target's configuration."""
    goal = Goal(state.target, task.arm.forward(state.target))  # type: ignore[arg-type]  # traced by jit
    now = task.begin_at(state.q, task.arm.forward(state.q), goal)  # type: ignore[arg-type]
    history = state.history
    if history is None:
        history = History(state.motion, state.commands, state.q)  # type: ignore[arg-type]
    return now._replace(history=history, command=state.commands[-1])


def at_rest(
    task: ReachingTask, q: np.ndarray, target: np.ndarray, observer: Observer | None
) -> ControllerState:
    """What a controller with this observer is given of a machine that has been at rest in `q`, both (n_joint,)."""
    history = jax.device_get(task.dynamics.at_rest(task.parameters, jnp.asarray(q, jnp.float32)))
    hidden = None if observer is None else observer.begin(q)
    return ControllerState(history.motion, history.commands, history.q, target, hidden)
