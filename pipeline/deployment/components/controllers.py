"""Controllers behind one interface: the autonomous server's state in, a command out. PPO's policies, and iCEM."""

import copy
import enum
from collections.abc import Callable
from typing import NamedTuple, Protocol

import jax
import numpy as np

from pipeline.control.icem.config import IcemConfig
from pipeline.control.icem.controller import icem_planner
from pipeline.control.icem.planner import PlannerState
from pipeline.control.policy import Policy
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.features import History
from pipeline.errors import InputError
from pipeline.reaching.task import Goal, ReachingTask, TaskState


class ControllerKind(enum.StrEnum):
    """What decides; each kind takes a time of its own to decide."""

    ppo = "ppo"
    icem = "icem"


class ControllerState(NamedTuple):
    """What a decision is made on; NumPy arrays, float32.

    Attributes:
        motion: the window's rows, (k+1, n_joint), oldest first: velocities or positions, as the model takes.
        commands: the commands before this decision, (k+1, n_joint), oldest first.
        q: present configuration, (n_joint,).
        target: configuration that the target pose maps to, (n_joint,).
    """

    motion: np.ndarray
    commands: np.ndarray
    q: np.ndarray
    target: np.ndarray


class Controller(Protocol):
    """Anything that decides; called every few ticks, and for one machine at a time."""

    def begin(self, goal_id: int) -> None:
        """A new goal: forget the plan for the last one. What is drawn for a goal depends on its number alone."""

    def decide(self, state: ControllerState) -> np.ndarray:
        """The command from now on, (n_joint,); values that are not finite where it cannot tell."""

    def fresh(self) -> "Controller":
        """Another one like it, for another machine; what is compiled is shared."""


class PolicyController:
    """A learned policy (PPO); deterministic."""

    def __init__(self, task: ReachingTask, policy: Policy) -> None:
        self._policy = policy

        def command(policy: Policy, state: ControllerState) -> tuple[jax.Array, jax.Array]:
            proto_action = policy.act(task.observe(_measured(task, state)))
            return proto_action, task.command(proto_action)

        self._command = jax.jit(command)

    def begin(self, goal_id: int) -> None:
        """A policy remembers nothing."""

    def decide(self, state: ControllerState) -> np.ndarray:
        """The policy's command; a proto-action that is not finite is passed on, discretising would hide it."""
        proto_action, command = jax.device_get(self._command(self._policy, state))
        return command if np.isfinite(proto_action).all() else proto_action

    def fresh(self) -> "PolicyController":
        """Itself: it remembers nothing."""
        return self


class IcemController:
    """Model predictive control (iCEM): every decision plans anew, from the plan before it moved on in time."""

    def __init__(self, task: ReachingTask, config: IcemConfig, action_repeats: int, seed: int) -> None:
        """A planner without a goal.

        Args:
            task: what to plan on; its reward is the planner's.
            config: budget and ingredients.
            action_repeats: ticks per decision.
            seed: of the samples; with the goal's number it decides them.

        Raises:
            InputError: the model has effects around it, whose states the machine does not tell; or the horizon
                is not longer than a decision.
        """
        if not isinstance(task.dynamics, DynamicsModel):
            raise InputError(
                "iCEM plans from what is measured, and the states of effects around a model are not: "
                "name a model without effects"
            )
        planner = icem_planner(task, config, action_repeats)

        def decide(plan: PlannerState, state: ControllerState) -> tuple[PlannerState, jax.Array]:
            return planner.decide(plan, _measured(task, state))

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
        if not all(np.isfinite(values).all() for values in state):
            return np.full_like(state.q, np.nan)  # every plan is as bad as any other: it cannot tell
        self._plan, command = self._decide(self._plan, state)
        return np.asarray(command)

    def fresh(self) -> "IcemController":
        """A planner without a goal that shares what is compiled."""
        other = copy.copy(self)
        other._plan = None
        return other


def _measured(task: ReachingTask, state: ControllerState) -> TaskState:
    """The task as the machine shows it: x̃ from the buffers, the target's configuration known."""
    goal = Goal(state.target, task.arm.forward(state.target))  # type: ignore[arg-type]  # traced by jit
    now = task.begin_at(state.q, task.arm.forward(state.q), goal)  # type: ignore[arg-type]
    history = History(state.motion, state.commands, state.q)  # type: ignore[arg-type]
    return now._replace(history=history, command=state.commands[-1])
