"""What a command sequence is worth: Σ_e γ^e Σ r over the ticks of entry e (paper, Eq. mpc_objective)."""

from typing import Any, Protocol

import jax
import jax.numpy as jnp

from pipeline.reaching.task import ReachingTask, TaskState


class SequenceReturns(Protocol):
    """Returns of many sequences that begin in one state; pure functions, without batch axes of their own."""

    def prepare(self, state: TaskState) -> Any:
        """What all sequences from this state share; computed once per decision."""

    def evaluate(self, prepared: Any, commands: jax.Array) -> jax.Array:
        """Returns (N,) of commands (N, H, n_joint), which the machine takes as they are."""


def discounted(rewards: jax.Array, discount: float) -> jax.Array:
    """Sum over ticks and entries, later entries discounted.

    Args:
        rewards: (H, ticks per entry, ...).
        discount: γ per entry.
    """
    weights = discount ** jnp.arange(rewards.shape[0], dtype=rewards.dtype)
    return jnp.tensordot(weights, rewards.sum(axis=1), axes=1)


class TickReturns:
    """By `ReachingTask.tick`, one tick after the other: for any dynamics that the task takes. The definition."""

    def __init__(self, task: ReachingTask, ticks_per_entry: int, discount: float) -> None:
        """Puts the parts together.

        Args:
            task: its reward is the planner's.
            ticks_per_entry: ticks that an entry is held for.
            discount: γ per entry.
        """
        self._task = task
        self._ticks_per_entry = ticks_per_entry
        self._discount = discount

    def prepare(self, state: TaskState) -> TaskState:
        """The state itself."""
        return state

    def evaluate(self, prepared: TaskState, commands: jax.Array) -> jax.Array:
        """See `SequenceReturns.evaluate`."""
        n = commands.shape[0]
        first = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (n, *jnp.shape(leaf))), prepared)

        def entry(state: TaskState, command: jax.Array) -> tuple[TaskState, jax.Array]:
            def tick(state: TaskState, _: None) -> tuple[TaskState, jax.Array]:
                state, outcome = self._task.tick(state, command)
                return state, outcome.reward

            return jax.lax.scan(tick, state, length=self._ticks_per_entry)

        _, rewards = jax.lax.scan(entry, first, jnp.swapaxes(commands, 0, 1))
        return discounted(rewards, self._discount)
