"""Controllers behind one interface: the autonomous server's state in, a command out."""

from typing import NamedTuple, Protocol

import jax
import numpy as np

from pipeline.control.policy import Policy
from pipeline.dynamics.features import History
from pipeline.reaching.task import Goal, ReachingTask


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

    def begin(self) -> None:
        """A new goal: forget the plan for the last one."""

    def decide(self, state: ControllerState) -> np.ndarray:
        """The command from now on, (n_joint,); values that are not finite where it cannot tell."""


class PolicyController:
    """A learned policy (PPO); deterministic."""

    def __init__(self, task: ReachingTask, policy: Policy) -> None:
        self._policy = policy

        def command(policy: Policy, history: History, target: jax.Array) -> tuple[jax.Array, jax.Array]:
            goal = Goal(target, task.arm.forward(target))
            now = task.begin_at(history.q, task.arm.forward(history.q), goal)._replace(history=history)
            proto_action = policy.act(task.observe(now))
            return proto_action, task.command(proto_action)

        self._command = jax.jit(command)

    def begin(self) -> None:
        """A policy remembers nothing."""

    def decide(self, state: ControllerState) -> np.ndarray:
        """The policy's command; a proto-action that is not finite is passed on, discretising would hide it."""
        history = History(state.motion, state.commands, state.q)  # type: ignore[arg-type]  # jit takes NumPy's
        proto_action, command = self._command(self._policy, history, state.target)
        values = np.asarray(proto_action)
        return np.asarray(command) if np.isfinite(values).all() else values
