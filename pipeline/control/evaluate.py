"""Evaluation over fixed episodes: every tick is traced, all episodes at once."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.control.policy import Policy
from pipeline.reaching.episodes import Episodes
from pipeline.reaching.metrics import Traces
from pipeline.reaching.task import ReachingTask, TaskState


def policy_evaluation(
    task: ReachingTask, action_repeats: int, episode_ticks: int
) -> Callable[[Policy, Episodes], Traces]:
    """A function from a policy and N episodes to their traces, compiled once per shape of its arguments.

    Args:
        task: the task.
        action_repeats: ticks per decision.
        episode_ticks: length of an episode.
    """

    def tick(state: TaskState, command: jax.Array) -> tuple[TaskState, dict[str, jax.Array]]:
        state, outcome = task.tick(state, command)
        return state, {
            "q": state.history.q,
            "command": command,
            "position": state.pose.position,
            "position_error": outcome.deviation.position,
            "pitch_error": outcome.deviation.pitch,
            "inside": outcome.inside,
            "below": outcome.below,
            "reward": outcome.reward,
        }

    def decide(policy: Policy, state: TaskState) -> tuple[TaskState, dict[str, jax.Array]]:
        command = task.command(policy.act(task.observe(state)))
        return jax.lax.scan(lambda s, _: tick(s, command), state, length=action_repeats)

    @jax.jit
    def run(policy: Policy, starts: jax.Array, targets: jax.Array) -> dict[str, jax.Array]:
        first = task.begin(starts, targets)
        n_decisions = episode_ticks // action_repeats
        _, trace = jax.lax.scan(lambda s, _: decide(policy, s), first, length=n_decisions)
        # (decision, repeat, episode, ...) -> (episode, tick, ...)
        trace = {
            name: jnp.moveaxis(value.reshape(-1, *value.shape[2:]), 0, 1) for name, value in trace.items()
        }
        return {**trace, "start_position": first.pose.position}

    def evaluate(policy: Policy, episodes: Episodes) -> Traces:
        trace = run(policy, jnp.asarray(episodes.starts), jnp.asarray(episodes.targets))
        return Traces(**{name: np.asarray(value) for name, value in trace.items()})

    return evaluate


def evaluate_policy(
    policy: Policy, task: ReachingTask, action_repeats: int, episode_ticks: int, episodes: Episodes
) -> Traces:
    """Run the deterministic policy through the episodes; see `policy_evaluation`."""
    return policy_evaluation(task, action_repeats, episode_ticks)(policy, episodes)
