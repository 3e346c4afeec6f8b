"""Evaluation over fixed episodes: every tick is traced, all episodes at once."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.control.policy import Policy
from pipeline.errors import InputError
from pipeline.reaching.episodes import Episodes
from pipeline.reaching.metrics import Traces
from pipeline.reaching.reward import RewardTerms
from pipeline.reaching.task import ReachingTask, TaskState


class EpisodeController(NamedTuple):
    """A controller: pure functions for one episode, of explicit parameters and an explicit carry.

    Attributes:
        begin: (parameters, key) to the carry at the start of an episode; `key` is consumed.
        decide: (parameters, carry, state) to the next carry and the command (n_joint,), which is held for the ticks
            of a decision.
    """

    begin: Callable[[Any, jax.Array], Any]
    decide: Callable[[Any, Any, TaskState], tuple[Any, jax.Array]]


class EvaluatedEpisodes(NamedTuple):
    """N episodes of T ticks.

    Attributes:
        traces: every tick.
        terms: every reward term of every tick, enabled or not, each (N, T).
    """

    traces: Traces
    terms: RewardTerms


def controller_evaluation(
    controller: EpisodeController, task: ReachingTask, action_repeats: int, episode_ticks: int
) -> Callable[[Any, Episodes, jax.Array], EvaluatedEpisodes]:
    """A function from a controller's parameters, N episodes and N keys, compiled once per shape of its arguments.

    Args:
        controller: the evaluated controller.
        task: task of the evaluation; the traces hold its reward.
        action_repeats: ticks per decision.
        episode_ticks: length of an episode.

    Raises:
        InputError: an episode is not a whole number of decisions.
    """
    if episode_ticks % action_repeats:
        raise InputError(
            f"episodes.steps {episode_ticks} is not a multiple of control.action_repeats {action_repeats}"
        )

    def tick(state: TaskState, command: jax.Array) -> tuple[TaskState, dict[str, Any]]:
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
            "terms": outcome.terms,
        }

    @jax.jit
    def run(parameters: Any, starts: jax.Array, targets: jax.Array, keys: jax.Array) -> dict[str, Any]:
        def decision(now: tuple[Any, TaskState], _: None) -> tuple[tuple[Any, TaskState], dict[str, Any]]:
            carry, state = now
            carry, command = jax.vmap(controller.decide, in_axes=(None, 0, 0))(parameters, carry, state)
            state, trace = jax.lax.scan(lambda s, _: tick(s, command), state, length=action_repeats)
            return (carry, state), trace

        first = task.begin(starts, targets)
        carry = jax.vmap(controller.begin, in_axes=(None, 0))(parameters, keys)
        _, trace = jax.lax.scan(decision, (carry, first), length=episode_ticks // action_repeats)
        # (decision, repeat, episode, ...) -> (episode, tick, ...)
        trace = jax.tree.map(lambda value: jnp.moveaxis(value.reshape(-1, *value.shape[2:]), 0, 1), trace)
        return {**trace, "start_position": first.pose.position}

    def evaluate(parameters: Any, episodes: Episodes, keys: jax.Array) -> EvaluatedEpisodes:
        trace = run(parameters, jnp.asarray(episodes.starts), jnp.asarray(episodes.targets), keys)
        trace = jax.tree.map(np.asarray, trace)
        terms = trace.pop("terms")
        return EvaluatedEpisodes(Traces(**trace), terms)

    return evaluate


def policy_controller(task: ReachingTask) -> EpisodeController:
    """A learned policy as a stateless, deterministic controller; the policy is its parameters."""

    def decide(policy: Policy, carry: None, state: TaskState) -> tuple[None, jax.Array]:
        return carry, task.command(policy.act(task.observe(state)))

    return EpisodeController(lambda policy, key: None, decide)


def policy_evaluation(
    task: ReachingTask, action_repeats: int, episode_ticks: int
) -> Callable[[Policy, Episodes], Traces]:
    """A function from a policy and N episodes to their traces, compiled once per shape of its arguments.

    Args:
        action_repeats: ticks per decision.
        episode_ticks: length of an episode.
    """
    run = controller_evaluation(policy_controller(task), task, action_repeats, episode_ticks)

    def evaluate(policy: Policy, episodes: Episodes) -> Traces:
        unused = jax.random.split(jax.random.key(0), len(episodes.starts))
        return run(policy, episodes, unused).traces

    return evaluate


def evaluate_policy(
    policy: Policy, task: ReachingTask, action_repeats: int, episode_ticks: int, episodes: Episodes
) -> Traces:
    """Run the deterministic policy through the episodes; see `policy_evaluation`."""
    return policy_evaluation(task, action_repeats, episode_ticks)(policy, episodes)
