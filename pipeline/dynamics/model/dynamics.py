"""The one interface of a dynamics model: environments, planners, the graph and predictors of logs know no other.

A new kind of model is one class that subclasses `Dynamics` and defines how it begins, steps and what a policy observes.
It inherits rollouts that call `step`. A kind with a faster way overrides them.
"""

from abc import abstractmethod
from collections.abc import Callable
from typing import Protocol, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.features import History, min_max, push
from pipeline.dynamics.model.specification import ModelSpecification, Target
from pipeline.dynamics.model.stops import Stops


class MeasuredHistory(Protocol):
    """What every kind of history shows; shapes and units as in `History`."""

    @property
    def motion(self) -> jax.Array:
        """(..., k+1, n_joint)."""

    @property
    def commands(self) -> jax.Array:
        """(..., k+1, n_joint)."""

    @property
    def q(self) -> jax.Array:
        """(..., n_joint)."""


P = TypeVar("P")  # parameters: a tree of arrays
P_contra = TypeVar("P_contra", contravariant=True)
H = TypeVar("H", bound=MeasuredHistory)  # what is known before a command: a tree of arrays


class Dynamics(Protocol[P_contra, H]):
    """Pure functions of (parameters, history, command); all take any leading axes.

    Attributes:
        specification: Joints, limits, rate and window.
        has_hidden_state: Whether a history holds more than the measured window, so that a `History` cannot replace it.
            Such a model needs a predictor of its own for logs, an `observe` and an `at_rest` of its own.
    """

    specification: ModelSpecification
    has_hidden_state: bool

    @abstractmethod
    def initial_history(self, q: jax.Array) -> H:
        """Begin: the history of a machine that has been at rest in `q` (..., n_joint), rad or m."""

    def at_rest(self, parameters: P_contra, q: jax.Array) -> H:
        """As `initial_history`, where what a machine at rest measures depends on the parameters."""
        return self.initial_history(q)

    @abstractmethod
    def features(self, history: MeasuredHistory) -> jax.Array:
        """Observe: the policy's x̃_t, (..., n_features), dimensionless, of commands up to a_{t-1}."""

    @abstractmethod
    def step(self, parameters: P_contra, history: H, command: jax.Array, stops: Stops | None = None) -> H:
        """Advance by one time step under `command` a_t (..., n_joint), in [-1, 1].

        Args:
            parameters: Of this kind of model.
            history: At t.
            command: a_t.
            stops: Where joints end; None: they do not.

        Returns:
            The history at t+1.
        """

    def observe(
        self, parameters: P_contra, history: H, q: jax.Array, velocity: jax.Array, command: jax.Array
    ) -> H:
        """Advance by one time step that was measured, not predicted.

        Args:
            parameters: As of `step`.
            history: At t.
            q: Measured at t+1, (..., n_joint), rad or m.
            velocity: Estimated at t+1, (..., n_joint), rad/s or m/s.
            command: a_t, in force between the two, (..., n_joint).

        Returns:
            The history at t+1.
        """
        newest = q if self.specification.target is Target.dq else velocity
        measured = {"motion": push(history.motion, newest), "commands": push(history.commands, command)}
        return history._replace(**measured, q=q)  # type: ignore[attr-defined]  # histories are named tuples

    def hold(
        self, parameters: P_contra, history: H, command: jax.Array, n_steps: int, stops: Stops | None = None
    ) -> tuple[H, jax.Array]:
        """Advance by `n_steps` under one command; parameters, command and stops as of `step`.

        The history's commands must have been held likewise: from the newest row back, every `n_steps` rows are equal.

        Returns:
            The history after the last step, and q after each, (n_steps, ..., n_joint), rad or m.
        """
        commands = jnp.broadcast_to(command, (n_steps, *command.shape))
        return _by_steps(self, parameters, history, commands, stops)

    def roll_out(
        self, parameters: P_contra, history: H, commands: jax.Array, stops: Stops | None = None
    ) -> jax.Array:
        """Predict in open loop; parameters and stops as of `step`.

        Every history (...) has commands of its own, a_t … a_{t+H-1}, (..., H, n_joint).

        Returns:
            (..., H, n_joint): q̂_{t+1} … q̂_{t+H}, rad or m.
        """
        _, q = _by_steps(self, parameters, history, jnp.moveaxis(commands, -2, 0), stops)
        return jnp.moveaxis(q, 0, -2)

    def held_rollout(
        self, parameters: P_contra, n_steps: int, stops: Stops | None = None
    ) -> Callable[[H, jax.Array], jax.Array]:
        """Roll out many sequences of held commands that share one history, as planners do.

        Args:
            parameters: As of `step`; values, not traced.
            n_steps: Steps that every command is held for.
            stops: As of `step`.

        Returns:
            A function of a history without leading axes, and of commands (N, H, n_joint). Its value is q after each
            step, (H, n_steps, N, n_joint), rad or m. The history's commands need not have been held.
        """

        def roll_out(history: H, commands: jax.Array) -> jax.Array:
            n, n_entries, n_joint = commands.shape
            first = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (n, *jnp.shape(leaf))), history)
            single = jnp.repeat(jnp.swapaxes(commands, 0, 1), n_steps, axis=0)
            _, q = _by_steps(self, parameters, first, single, stops)
            return q.reshape(n_entries, n_steps, n, n_joint)

        return roll_out

    def history_from_rows(self, q: jax.Array, qd: jax.Array, a: jax.Array) -> History:
        """Measured window at step t from logged rows that end with row t.

        Args:
            q: (..., rows, n_joint) positions; rows >= k+2, the last is row t.
            qd: (..., rows, n_joint) velocity estimates; that of row t is the newest.
            a: (..., rows, n_joint) commands; that of row t is about to act and not part of the history.
        """
        n_rows = self.specification.lags + 1
        if q.shape[-2] < n_rows + 1:
            raise ValueError(
                f"history_from_rows: got {q.shape[-2]} rows, expected at least lags + 2 = {n_rows + 1}"
            )
        motion = q if self.specification.target is Target.dq else qd
        return History(motion=motion[..., -n_rows:, :], commands=a[..., -n_rows - 1 : -1, :], q=q[..., -1, :])

    def normalise_position(self, q: jax.Array) -> jax.Array:
        """Min-max of configurations (..., n_joint) by the joint limits."""
        specification = self.specification
        lower, upper = np.asarray(specification.position_lower), np.asarray(specification.position_upper)
        return min_max(q, lower, upper)


def _by_steps(
    model: Dynamics[P, H], parameters: P, history: H, commands: jax.Array, stops: Stops | None
) -> tuple[H, jax.Array]:
    """The history after commands (H, ..., n_joint), steps in front, and q after each."""

    def advance(history: H, command: jax.Array) -> tuple[H, jax.Array]:
        history = model.step(parameters, history, command, stops)
        return history, history.q

    return jax.lax.scan(advance, history, commands)
