"""The planner as a controller of the reaching task."""

from typing import Any

import jax

from pipeline.control.evaluate import EpisodeController
from pipeline.control.icem.config import IcemConfig
from pipeline.control.icem.planner import Planner, PlannerState
from pipeline.control.icem.returns import SequenceReturns, sequence_returns
from pipeline.reaching.task import ReachingTask, TaskState


def icem_planner(
    task: ReachingTask, config: IcemConfig, action_repeats: int, returns: SequenceReturns | None = None
) -> Planner:
    """The planner of a task.

    Args:
        task: what to plan on; its reward is the planner's.
        config: budget and ingredients.
        action_repeats: ticks per decision.
        returns: what sequences are worth; None: on the task's dynamics.

    Raises:
        InputError: the horizon is not longer than a decision.
    """
    if returns is None:
        returns = sequence_returns(task, config.ticks_per_entry(action_repeats), config.discount)
    entries = config.entries_per_decision(action_repeats)
    return Planner(config, returns, task.command, task.machine.n_joint, entries)


def icem_controller(task: ReachingTask, config: IcemConfig, action_repeats: int) -> EpisodeController:
    """The planner for `controller_evaluation`: it has no parameters, its carry is the planner's state."""
    planner = icem_planner(task, config, action_repeats)

    def begin(parameters: Any, key: jax.Array) -> PlannerState:
        del parameters
        return planner.begin(key)

    def decide(parameters: Any, carry: PlannerState, state: TaskState) -> tuple[PlannerState, jax.Array]:
        del parameters
        return planner.decide(carry, state)

    return EpisodeController(begin, decide)
