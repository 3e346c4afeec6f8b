"""The reaching task as a Brax environment: one step is one decision, held for several ticks."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

import pipeline.machine.quiet_mjx  # noqa: F401 # isort: skip (before Brax)
from brax.envs.base import Env, State

from pipeline.errors import InputError
from pipeline.machine.poses import PoseTable
from pipeline.reaching.metrics import REPORTED_PRECISIONS, success_key
from pipeline.reaching.reward import RewardTerm, RewardTerms
from pipeline.reaching.task import Goal, ReachingTask, TaskState


class EpisodeState(NamedTuple):
    """Brax's `pipeline_state`: the task, and events of the episode so far, over all ticks.

    Attributes:
        task: state of the task.
        reached: whether each of `REPORTED_PRECISIONS` was met, boolean, shape (..., n_precision).
        left_workspace: whether the pose was outside W+, boolean, shape (...).
        went_below: whether the tip was below W+'s lower plane, boolean, shape (...).
    """

    task: TaskState
    reached: jax.Array
    left_workspace: jax.Array
    went_below: jax.Array


class DecisionSums(NamedTuple):
    """Reward and every term, enabled or not, summed over the ticks of a decision; shape (...)."""

    reward: jax.Array
    terms: RewardTerms


class ReachingEnvironment(Env):
    """Brax-compliant environment of the reaching task.

    `reset` takes one key; `step` works over any leading axes, so that it needs no `vmap`. A step turns the
    proto-action in [-1, 1]^n into a command, holds it for `action_repeats` ticks and sums the reward over
    them; there are no terminal states. `metrics` holds the step's reward per term, and for success, leaving
    W+ and going below its lower plane 1 in the step of the episode in which it first happened: summed over an
    episode, as Brax's wrappers do, they are the paper's metrics, ticks inside action repeats included.
    """

    def __init__(self, task: ReachingTask, poses: PoseTable, action_repeats: int, episode_ticks: int) -> None:
        """Makes the environment.

        Args:
            poses: table from which starts and targets are drawn.
            action_repeats: ticks per decision.
            episode_ticks: T_reset.

        Raises:
            InputError: an episode is not a whole number of decisions.
        """
        if episode_ticks % action_repeats:
            raise InputError(
                f"episodes.steps {episode_ticks} is not a multiple of control.action_repeats {action_repeats}"
            )
        self.task = task
        self.poses = poses
        self.action_repeats = action_repeats
        self.episode_ticks = episode_ticks

    @property
    def observation_size(self) -> int:
        """Dimension of an observation."""
        return self.task.observation_size

    @property
    def action_size(self) -> int:
        """Number of joints."""
        return self.task.machine.n_joint

    @property
    def backend(self) -> str:
        """Name of the simulator: a learned model instead of one of Brax's engines."""
        return "learned"

    def new_episode(self, key: jax.Array) -> EpisodeState:
        """A new start and a new target from the table, and an empty history; `key` is consumed."""
        start_key, goal_key = jax.random.split(key)
        start, pose = self.poses.draw(start_key)
        goal = Goal(*self.poses.draw(goal_key))
        return EpisodeState(
            task=self.task.begin_at(start, pose, goal),
            reached=jnp.zeros(len(REPORTED_PRECISIONS), bool),
            left_workspace=jnp.zeros((), bool),
            went_below=jnp.zeros((), bool),
        )

    def reset(self, rng: jax.Array) -> State:
        """First state of a new episode."""
        episode = self.new_episode(rng)
        zero = jnp.zeros(())
        metrics = {
            f"reward_{term}": zero for term in RewardTerm
        } | {
            success_key(*precision): zero for precision in REPORTED_PRECISIONS
        } | {"out_of_workspace": zero, "below_lower_plane": zero}  # fmt: skip
        return State(
            episode, self.task.observe(episode.task), reward=zero, done=zero, metrics=metrics, info={}
        )

    def step(self, state: State, action: jax.Array) -> State:
        """One decision: `action_repeats` ticks under the command of proto-action `action` (..., n_joint)."""
        before = state.pipeline_state
        episode, sums = self._decide(before, self.task.command(action))
        newly = {
            success_key(*precision): (episode.reached & ~before.reached)[..., index]
            for index, precision in enumerate(REPORTED_PRECISIONS)
        }
        newly["out_of_workspace"] = episode.left_workspace & ~before.left_workspace
        newly["below_lower_plane"] = episode.went_below & ~before.went_below
        metrics = {
            **state.metrics,  # wrappers keep their own entries here
            **{f"reward_{term}": getattr(sums.terms, term) for term in RewardTerm},
            **{name: value.astype(jnp.float32) for name, value in newly.items()},
        }
        return state.replace(
            pipeline_state=episode,
            obs=self.task.observe(episode.task),
            reward=sums.reward,
            done=jnp.zeros_like(state.done),
            metrics=metrics,
        )

    def _decide(self, before: EpisodeState, command: jax.Array) -> tuple[EpisodeState, DecisionSums]:
        task, outcome = self.task.hold(before.task, command, self.action_repeats)
        errors = jnp.stack([outcome.deviation.position, jnp.abs(outcome.deviation.pitch)], axis=-1)
        reached = jnp.all(errors[..., None, :] < jnp.asarray(REPORTED_PRECISIONS), axis=-1)
        after = EpisodeState(
            task=task,
            reached=before.reached | reached.any(axis=0),
            left_workspace=before.left_workspace | ~outcome.inside.all(axis=0),
            went_below=before.went_below | outcome.below.any(axis=0),
        )
        ticks = DecisionSums(outcome.reward, outcome.terms)
        return after, jax.tree.map(lambda value: value.sum(axis=0), ticks)
