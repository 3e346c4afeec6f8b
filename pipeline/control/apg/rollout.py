"""The return of a policy over some decisions, as a function that has a gradient through the learned model.

A model learns from a machine's discrete commands alone and may be flat at them. At rest, for example, one short command
moves nothing, though two move a joint. By the fundamental theorem of calculus its gradients on the way from one command
to another average to what the switch does. `Between` takes gradients there; values stay those of exact commands.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from pipeline.control.apg.config import APGConfig
from pipeline.control.apg.objective import cost
from pipeline.control.policy import Policy
from pipeline.dynamics.model.features import History
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


class Between(NamedTuple):
    """Where on the way to another command the model's gradient is taken, for n episodes.

    Attributes:
        share: of the way, in [0, 1], (n, 1).
        other: discrete command at its end, (n, n_joint).
    """

    share: jax.Array
    other: jax.Array

    @classmethod
    def draw(cls, key: jax.Array, n: int, n_joint: int) -> "Between":
        """Uniform; `key` is consumed."""
        share_key, other_key = jax.random.split(key)
        other = jax.random.randint(other_key, (n, n_joint), -1, 2)
        return cls(jax.random.uniform(share_key, (n, 1)), other.astype(jnp.float32))

    def of_command(self, command: jax.Array) -> jax.Array:
        """`command` (n, n_joint) moved towards the other one; its derivative is 1."""
        return command + jax.lax.stop_gradient(self.share * (self.other - command))

    def of_history(self, history: Any) -> Any:
        """The history with all its commands moved; those of a window inside it, which effects have, as well."""
        rows = Between(self.share[:, None], self.other[:, None])
        moved = {"commands": rows.of_command(history.commands)}
        for name, value in history._asdict().items():
            if isinstance(value, History):
                moved[name] = self.of_history(value)
        return history._replace(**moved)


Hold = Callable[[Any, jax.Array], tuple[Any, jax.Array]]


def with_gradient_between(hold: Hold, between: Between) -> Hold:
    """`hold` of a history and a command, whose values are its own and whose gradient is that at moved commands."""

    def held(history: Any, command: jax.Array) -> tuple[Any, jax.Array]:
        exact = jax.lax.stop_gradient(hold(*jax.lax.stop_gradient((history, command))))
        moved = hold(between.of_history(history), between.of_command(command))
        return jax.tree.map(_with_gradient_of, exact, moved)

    return held


def _with_gradient_of(value: jax.Array, moved: jax.Array) -> jax.Array:
    is_float = jnp.issubdtype(value.dtype, jnp.floating)
    return value + (moved - jax.lax.stop_gradient(moved)) if is_float else value


def discounted_cost(
    config: APGConfig,
    task: ReachingTask,
    action_repeats: int,
    policy: Policy,
    state: TaskState,
    noise: jax.Array,
    between: Between | None = None,
) -> tuple[jax.Array, TaskState]:
    """Σ γ^t cost of decision t, averaged over episodes.

    Args:
        config: horizon, discount and objective.
        task: on the learned model.
        action_repeats: ticks per decision.
        policy: that decides.
        state: episodes before the first decision, (n, ...).
        noise: added to proto-actions, (horizon, n, n_joint).
        between: where the model's gradient is taken; None: at the commands themselves.

    Returns:
        The cost, and the episodes after the last decision.
    """

    def exact(history: Any, command: jax.Array) -> tuple[Any, jax.Array]:
        return task.dynamics.hold(task.parameters, history, command, action_repeats, task.stops)

    hold: Hold = exact if between is None else with_gradient_between(exact, between)

    def decide(state: TaskState, noise: jax.Array) -> tuple[TaskState, tuple[jax.Array, ...]]:
        seen = task.observe(state)
        seen = config.feedback * seen + (1.0 - config.feedback) * jax.lax.stop_gradient(seen)
        command = straight_through(task.machine.command_kind, policy.act(seen) + noise, config.step_slope)
        history, q = hold(state.history, command)
        after = TaskState(history, task.arm.forward(history.q), command, state.goal)
        return after, (q, command, state.command)

    after, (q, command, previous) = jax.lax.scan(decide, state, noise)
    # The objective of all decisions at once: its many small operations are cheaper over long axes.
    costs = cost(config.objective, task, state.goal, jnp.moveaxis(q, 1, 0), command, previous)
    weights = config.discount ** jnp.arange(len(noise))
    return weights @ costs.mean(axis=1), after
