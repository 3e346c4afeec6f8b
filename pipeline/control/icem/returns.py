"""What a command sequence is worth: Σ_e γ^e Σ r over the ticks of entry e (paper, Eq. mpc_objective)."""

from collections.abc import Callable

import jax
import jax.numpy as jnp

from pipeline.reaching.task import ReachingTask, TaskState

SequenceReturns = Callable[[TaskState, jax.Array], jax.Array]
"""Returns (N,) of a state without leading axes, and of the machine's commands (N, H, n_joint)."""


def sequence_returns(task: ReachingTask, ticks_per_entry: int, discount: float) -> SequenceReturns:
    """Returns on the task's dynamics: all ticks are rolled out first, then judged at once.

    Args:
        task: its reward is the planner's.
        ticks_per_entry: ticks that an entry is held for.
        discount: γ per entry.
    """
    roll_out = task.dynamics.held_rollout(task.parameters, ticks_per_entry, task.stops)

    def returns(state: TaskState, commands: jax.Array) -> jax.Array:
        q = roll_out(state.history, commands)
        # Within an entry the command does not change; from one to the next it may.
        acting = jnp.swapaxes(commands, 0, 1)[:, None]
        before = jnp.concatenate([jnp.broadcast_to(state.command, acting[:1].shape), acting[:-1]])
        held = (*acting.shape[:1], q.shape[1] - 1, *acting.shape[2:])
        previous = jnp.concatenate([before, jnp.broadcast_to(acting, held)], axis=1)
        pose = task.arm.forward(q)
        outcome = task.outcome(q, pose, state.goal, jnp.broadcast_to(acting, q.shape), previous)
        return discounted(outcome.reward, discount)

    return returns


def discounted(rewards: jax.Array, discount: float) -> jax.Array:
    """Sum over ticks and entries, later entries discounted.

    Args:
        rewards: (H, ticks per entry, ...).
        discount: γ per entry.
    """
    weights = discount ** jnp.arange(rewards.shape[0], dtype=rewards.dtype)
    return jnp.tensordot(weights, rewards.sum(axis=1), axes=1)
