"""The reaching task on a model whose effects are not known exactly: every episode has values of its own."""

from collections.abc import Callable
from functools import partial

import jax

from pipeline.effects.augmented_model import AugmentedModel, AugmentedParameters
from pipeline.effects.chain import ChainValues
from pipeline.machine.poses import PoseTable
from pipeline.reaching.environment import EpisodeState, ReachingEnvironment
from pipeline.reaching.task import ReachingTask, TaskState


def with_values(task: ReachingTask, state: TaskState, values: ChainValues, key: jax.Array) -> TaskState:
    """The start of one episode with these values of the effects, and with what they hide drawn; `key` is consumed."""
    model: AugmentedModel = task.dynamics  # type: ignore[assignment]
    known: AugmentedParameters = task.parameters  # type: ignore[assignment]
    history = model.at_rest(known._replace(effects=values), state.history.q)
    return state._replace(history=history._replace(values=values, chain=model.chain.drawn(values, key)))


class DrawnEnvironment(ReachingEnvironment):
    """Draws the effects' values at the start of every episode."""

    def __init__(
        self,
        task: ReachingTask,
        poses: PoseTable,
        action_repeats: int,
        episode_ticks: int,
        draw: Callable[[jax.Array], ChainValues],
    ) -> None:
        """As of `ReachingEnvironment`; `draw` takes a key, which it consumes."""
        super().__init__(task, poses, action_repeats, episode_ticks)
        self._draw = draw

    def new_episode(self, key: jax.Array) -> EpisodeState:
        """See `ReachingEnvironment.new_episode`."""
        key, own, hidden = jax.random.split(key, 3)
        episode = super().new_episode(key)
        return episode._replace(task=with_values(self.task, episode.task, self._draw(own), hidden))


class TaskOnDraws(ReachingTask):
    """The same task, whose N episodes have the N values given."""

    def __init__(self, task: ReachingTask, values: ChainValues, keys: jax.Array) -> None:
        """Values (N, n_joint, ...) and keys (N,) of what they hide."""
        super().__init__(task.machine, task.arm, task.dynamics, task.parameters, task.reward)
        self._drawn = values, keys

    def begin(self, start: jax.Array, goal: jax.Array) -> TaskState:
        """See `ReachingTask.begin`; both (N, n_joint)."""
        return jax.vmap(partial(with_values, self))(super().begin(start, goal), *self._drawn)
