"""Returns of command sequences on an identified model, as fast as two cores allow; equal to `TickReturns`."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from pipeline.control.icem.returns import SequenceReturns, TickReturns, discounted
from pipeline.control.icem.windowed_rollout import SharedPart, WindowedRollout
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.machine.poses import workspace_of
from pipeline.reaching.task import Goal, ReachingTask, TaskState
from pipeline.reaching.tip import tip_pose


class Prepared(NamedTuple):
    """What all sequences from one state share.

    Attributes:
        rollout: part of the dynamics.
        command: of the last tick, (n_joint,).
        goal: the target.
    """

    rollout: SharedPart
    command: jax.Array
    goal: Goal


class WindowedReturns:
    """All ticks are rolled out first (`WindowedRollout`), then judged at once; see `SequenceReturns`."""

    def __init__(self, task: ReachingTask, n_entries: int, ticks_per_entry: int, discount: float) -> None:
        """Puts the parts together.

        Args:
            task: its reward is the planner's.
            n_entries: H, entries of a sequence.
            ticks_per_entry: ticks that an entry is held for.
            discount: γ per entry.
        """
        machine = task.machine
        self._task = task
        self._discount = discount
        self._workspace = workspace_of(machine)
        self._rollout = WindowedRollout(
            task.dynamics, task.parameters, machine.lower, machine.upper, n_entries, ticks_per_entry
        )

    def prepare(self, state: TaskState) -> Prepared:
        """The history's part of the first layer, and the goal."""
        return Prepared(self._rollout.prepare(state.history), state.command, state.goal)

    def evaluate(self, prepared: Prepared, commands: jax.Array) -> jax.Array:
        """See `SequenceReturns.evaluate`."""
        q = self._rollout.configurations(prepared.rollout, commands)
        # Within an entry the command does not change; from one to the next it may.
        acting = jnp.swapaxes(commands, 0, 1)[:, None]
        before = jnp.concatenate([jnp.broadcast_to(prepared.command, acting[:1].shape), acting[:-1]])
        held = (*acting.shape[:1], q.shape[1] - 1, *acting.shape[2:])
        previous = jnp.concatenate([before, jnp.broadcast_to(acting, held)], axis=1)
        rewards = self._rewards(prepared, q, jnp.broadcast_to(acting, q.shape), previous)
        return discounted(rewards, self._discount)

    def _rewards(
        self, prepared: Prepared, q: jax.Array, command: jax.Array, previous: jax.Array
    ) -> jax.Array:
        """Rewards (...) of ticks that reached q (..., n_joint)."""
        pose = tip_pose(self._task.arm.description, q)
        return self._task.outcome(q, pose, prepared.goal, command, previous).reward


def sequence_returns(
    task: ReachingTask, n_entries: int, ticks_per_entry: int, discount: float
) -> SequenceReturns:
    """The fastest way that holds for the task's dynamics: windows for identified models, else tick by tick."""
    if type(task.dynamics) is DynamicsModel:  # a subclass may step in another way
        return WindowedReturns(task, n_entries, ticks_per_entry, discount)
    return TickReturns(task, ticks_per_entry, discount)
