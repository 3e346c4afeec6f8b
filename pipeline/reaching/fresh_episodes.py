"""Vectorised environments for learning, in which every episode is a new one.

Brax's own wrappers reset an environment to its first start state: each would see a single start and target
for the whole training. Here every episode draws both anew and clears its history (paper,
"Episodic conditions").
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

import pipeline.machine.quiet_mjx  # noqa: F401 # isort: skip (before Brax)
from brax.envs.base import State, Wrapper

from pipeline.reaching.environment import ReachingEnvironment


class FreshEpisodes(Wrapper):
    """A batch of environments with time-outs and new episodes, instead of Brax's training wrappers.

    At the time-out `done` and `info["truncation"]` are both 1: Brax's PPO then treats the step as neither
    terminal nor as leading to the next episode's first state (it masks its advantage). `reward` and `metrics`
    are of the episode that ended, `obs` is the first observation of the next one.
    """

    env: ReachingEnvironment

    def __init__(self, env: ReachingEnvironment, staggered: bool) -> None:
        """Wraps the environment.

        Args:
            staggered: begin the first episodes at clocks spread evenly over an episode, so that time-outs and
                episode phases are spread in time. Otherwise all episodes run in step.
        """
        super().__init__(env)
        self._staggered = staggered

    def reset(self, rng: jax.Array) -> State:
        """First states of as many episodes as there are keys, shape (n, 2)."""
        keys = jax.vmap(jax.random.split)(rng)
        state = jax.vmap(self.env.reset)(keys[:, 0])
        zero = jnp.zeros(rng.shape[0])
        episode_metrics = {name: zero for name in (*state.metrics, "sum_reward", "length")}
        info: dict[str, Any] = {
            "key": keys[:, 1],
            "steps": self._first_clocks(rng.shape[0]),
            "truncation": zero,
            "episode_done": zero,
            "episode_metrics": episode_metrics,
        }
        return state.replace(info={**state.info, **info})

    def step(self, state: State, action: jax.Array) -> State:
        """One decision in every environment; those that time out begin a new episode."""
        clock = jnp.where(state.done == 1.0, 0.0, state.info["steps"])
        state = self.env.step(state, action)
        clock = clock + self.env.action_repeats
        done = clock >= self.env.episode_ticks

        keys = jax.vmap(jax.random.split)(state.info["key"])
        fresh = jax.vmap(self.env.new_episode)(keys[:, 0])
        episode = jax.tree.map(lambda new, old: where_over(done, new, old), fresh, state.pipeline_state)

        time_out = done.astype(jnp.float32)
        info = {
            **state.info,
            "key": keys[:, 1],
            "steps": clock,
            "truncation": time_out,
            "episode_done": time_out,
            "episode_metrics": self._accumulated(state),
        }
        return state.replace(
            pipeline_state=episode, obs=self.env.task.observe(episode.task), done=time_out, info=info
        )

    def _first_clocks(self, n: int) -> jax.Array:
        if not self._staggered:
            return jnp.zeros(n)
        decisions = self.env.episode_ticks // self.env.action_repeats
        return (jnp.arange(n) * decisions // n * self.env.action_repeats).astype(jnp.float32)

    def _accumulated(self, state: State) -> dict[str, jax.Array]:
        """Sums over the episode so far, reset after its end, for Brax's training log."""
        step = {
            **{name: state.metrics[name] for name in state.info["episode_metrics"] if name in state.metrics},
            "sum_reward": state.reward,
            "length": jnp.full_like(state.reward, self.env.action_repeats),
        }
        ongoing = 1.0 - state.info["episode_done"]
        return {name: ongoing * state.info["episode_metrics"][name] + value for name, value in step.items()}


def fresh_episodes(staggered: bool) -> Callable[..., FreshEpisodes]:
    """A `wrap_env_fn` for `brax.training.agents.ppo.train`."""

    def wrap(env: ReachingEnvironment, **_: Any) -> FreshEpisodes:
        # Brax passes episode length and action repeats, which the environment has, and no randomisation
        return FreshEpisodes(env, staggered)

    return wrap


def where_over(over: jax.Array, new: jax.Array, old: jax.Array) -> jax.Array:
    """`new` (n, ...) for the episodes that are `over` (n,), `old` for the others."""
    return jnp.where(over.reshape(over.shape + (1,) * (new.ndim - 1)), new, old)
