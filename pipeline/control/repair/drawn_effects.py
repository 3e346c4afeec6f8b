"""The reaching task on a model whose effects are not known exactly: every episode has values of its own."""

from collections.abc import Callable

import jax

from pipeline.effects.augmented_model import AugmentedParameters
from pipeline.effects.chain import ChainValues
from pipeline.machine.poses import PoseTable
from pipeline.reaching.environment import EpisodeState, ReachingEnvironment
from pipeline.reaching.task import ReachingTask, TaskState


def with_values(task: ReachingTask, state: TaskState, values: ChainValues) -> TaskState:
    """The start of an episode in which the effects have these values, with the axes of the state in front."""
    known: AugmentedParameters = task.parameters  # type: ignore[assignment]  # of a model with effects
    parameters = known._replace(effects=values)
    history = task.dynamics.at_rest(parameters, state.history.q)._replace(values=values)
    return state._replace(history=history)


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
        key, own = jax.random.split(key)
        episode = super().new_episode(key)
        return episode._replace(task=with_values(self.task, episode.task, self._draw(own)))


class TaskOnDraws(ReachingTask):
    """The same task, whose N episodes have the N values given."""

    def __init__(self, task: ReachingTask, values: ChainValues) -> None:
        """Values (N, n_joint, ...)."""
        super().__init__(task.machine, task.arm, task.dynamics, task.parameters, task.reward)
        self._values = values

    def begin(self, start: jax.Array, goal: jax.Array) -> TaskState:
        """See `ReachingTask.begin`; both (N, n_joint)."""
        return with_values(self, super().begin(start, goal), self._values)
