"""The return of a policy over some decisions, as a function that has a gradient through the learned model."""

import jax
import jax.numpy as jnp

from pipeline.control.apg.config import APGConfig
from pipeline.control.apg.objective import cost
from pipeline.control.policy import Policy
from pipeline.machine.specification import CommandKind
from pipeline.reaching.discretise import PROTO_ACTION_THRESHOLD, command_from_proto_action
from pipeline.reaching.task import ReachingTask, TaskState


def straight_through(kind: CommandKind, proto_action: jax.Array, slope: float) -> jax.Array:
    """The machine's command, to the last bit; a discrete one has the gradient of a smooth double step."""
    command = command_from_proto_action(kind, proto_action)
    if kind is not CommandKind.discrete:
        return command
    sides = (proto_action - PROTO_ACTION_THRESHOLD, proto_action + PROTO_ACTION_THRESHOLD)
    smooth = 0.5 * sum(jnp.tanh(slope * side) for side in sides)
    return jax.lax.stop_gradient(command) + (smooth - jax.lax.stop_gradient(smooth))


def discounted_cost(
    config: APGConfig,
    task: ReachingTask,
    action_repeats: int,
    policy: Policy,
    state: TaskState,
    noise: jax.Array,
) -> tuple[jax.Array, TaskState]:
    """Σ γ^t cost of decision t, averaged over episodes.

    Args:
        config: horizon, discount and objective.
        task: on the learned model.
        action_repeats: ticks per decision.
        policy: that decides.
        state: episodes before the first decision, (n, ...).
        noise: added to proto-actions, (horizon, n, n_joint).

    Returns:
        The cost, and the episodes after the last decision.
    """

    def decide(state: TaskState, noise: jax.Array) -> tuple[TaskState, tuple[jax.Array, ...]]:
        seen = task.observe(state)
        seen = config.feedback * seen + (1.0 - config.feedback) * jax.lax.stop_gradient(seen)
        command = straight_through(task.machine.command_kind, policy.act(seen) + noise, config.step_slope)
        history, q = task.dynamics.hold(task.parameters, state.history, command, action_repeats, task.stops)
        after = TaskState(history, task.arm.forward(history.q), command, state.goal)
        return after, (q, command, state.command)

    after, (q, command, previous) = jax.lax.scan(decide, state, noise)
    # The objective of all decisions at once: its many small operations are cheaper over long axes.
    costs = cost(config.objective, task, state.goal, jnp.moveaxis(q, 1, 0), command, previous)
    weights = config.discount ** jnp.arange(len(noise))
    return weights @ costs.mean(axis=1), after
