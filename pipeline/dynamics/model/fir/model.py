"""A nonlinear finite-impulse-response (NFIR) model in output-error form.

    q_{t+1} = stop(q_t + Δt · f(a_{t-k} … a_t, q_t))

No measured velocity is fed back. So an error of one step is not in the input of the next, and whatever the history,
a velocity is bounded by the commands, which are. f is trained to be the mean of an ensemble, and is what controllers
roll out. The spread of the ensemble's members is the model's uncertainty.
"""

import copy
import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.features import History, push
from pipeline.dynamics.model.fir.network import FirNetwork
from pipeline.dynamics.model.fir.specification import FirSpecification
from pipeline.dynamics.model.network import Layer, Parameters, apply
from pipeline.dynamics.model.rollouts.held_command import after_hold, by_held_commands, held_commands
from pipeline.dynamics.model.rollouts.held_rollout import windows_of
from pipeline.dynamics.model.stops import Stops

MEMBERS = "members"  # their parameters, stacked in front


class FirModel(DynamicsModel):
    """Its `History` is that of a Δq̇ model, so that policies see the same x̃. The velocities in it go nowhere else."""

    specification: FirSpecification
    network: FirNetwork

    def __init__(self, specification: FirSpecification) -> None:
        super().__init__(specification)
        self.member = self._of(specification.member_hidden)
        self._has_own_stops = True

    def members(self, parameters: Parameters) -> tuple["FirModel", list[Parameters]]:
        """Each member as a model of its own: one model, and its parameters per member."""
        alone = FirModel(dataclasses.replace(self.specification, hidden=self.specification.member_hidden))
        n_members = self.specification.members
        return alone, [jax.tree.map(lambda of, at=at: of[at], parameters[MEMBERS]) for at in range(n_members)]

    def initialise(self, key: jax.Array) -> Parameters:
        """Draw the parameters of f and of all members; `key` is consumed."""
        own, *others = jax.random.split(key, self.specification.members + 1)
        members = [self.member.initialise(other) for other in others]
        return self.network.initialise(own) | {MEMBERS: jax.tree.map(lambda *of: jnp.stack(of), *members)}

    def step(
        self, parameters: Parameters, history: History, command: jax.Array, stops: Stops | None = None
    ) -> History:
        """See `Dynamics.step`."""
        commands = push(history.commands, command)
        residual = self.velocity(parameters, self.inputs(commands, history.q))
        q, newest = self._moved(history.q, history.motion[..., -1, :], residual, stops)
        return History(motion=push(history.motion, newest), commands=commands, q=q)

    def hold(
        self,
        parameters: Parameters,
        history: History,
        command: jax.Array,
        n_steps: int,
        stops: Stops | None = None,
    ) -> tuple[History, jax.Array]:
        """See `Dynamics.hold`: what held commands add to the first layer is one product for all steps."""
        first, *others, by_q = self._split(self.network.layers(parameters))
        kernels = self._held_kernels(first, n_steps)
        held = self.member.rows(held_commands(history, command, n_steps, kernels.shape[1]))
        by_commands = jnp.concatenate(list(kernels.reshape(n_steps, -1, kernels.shape[-1])), axis=-1)
        driven = jnp.split(_flat(held) @ by_commands, n_steps, axis=-1)
        q, newest, visited, appended = history.q, history.motion[..., -1, :], [], []
        for y in driven:
            q, newest, _ = self.finish_step(
                others, y + first.bias + self.normalise_position(q) @ by_q, q, newest, stops
            )
            visited.append(q)
            appended.append(newest)
        return after_hold(history, command, appended, q), jnp.stack(visited)

    def roll_out(
        self, parameters: Parameters, history: History, commands: jax.Array, stops: Stops | None = None
    ) -> jax.Array:
        """See `Dynamics.roll_out`."""
        first, *others, by_q = self._split(self.network.layers(parameters))
        row = self.member.row
        # The window of step j holds commands j … j+k of this buffer; the oldest command is in no window any more.
        known = _flat(self.member.rows(jnp.concatenate([history.commands[..., 1:, :], commands], axis=-2)))

        def advance(carry: tuple, index: jax.Array) -> tuple[tuple, jax.Array]:
            q, newest = carry
            acting = jax.lax.dynamic_slice_in_dim(known, index * row, len(first.kernel), axis=-1)
            y = acting @ first.kernel + self.normalise_position(q) @ by_q + first.bias
            q, newest, _ = self.finish_step(others, y, q, newest, stops)
            return (q, newest), q

        begin = (history.q, history.motion[..., -1, :])
        _, q = jax.lax.scan(advance, begin, jnp.arange(commands.shape[-2]))
        return jnp.moveaxis(q, 0, -2)

    def velocity(self, parameters: Parameters, inputs: jax.Array) -> jax.Array:
        """Velocity by f, of `inputs` and before stops: (..., n_joint), rad/s or m/s."""
        return self.scale_residual(apply(self.network, parameters, inputs))

    def members_velocity(self, parameters: Parameters, inputs: jax.Array) -> jax.Array:
        """Velocity by each member, of `inputs` and before stops: (n_members, ..., n_joint), rad/s or m/s."""
        return self.scale_residual(jax.vmap(lambda own: apply(self.member, own, inputs))(parameters[MEMBERS]))

    def held_rollout(
        self, parameters: Parameters, n_steps: int, stops: Stops | None = None
    ) -> Callable[[History, jax.Array], jax.Array]:
        """See `Dynamics.held_rollout`: what measured commands add is the same for all sequences."""
        first, *others, by_q = self._split(self.network.layers(parameters))
        kernels = self._held_kernels(first, n_steps)[:, ::-1]  # oldest first
        n_held, width = kernels.shape[1], kernels.shape[-1]
        by_held = jnp.concatenate(list(kernels.reshape(n_steps, -1, width)), axis=-1)
        row = self.member.row

        def roll_out(history: History, commands: jax.Array) -> jax.Array:
            n, n_entries, _ = commands.shape
            measured = windows_of(self.member.rows(history.commands[1:]), n_entries * n_steps)
            shared = first.bias + jnp.pad(measured, ((0, 0), (0, row))) @ first.kernel
            entries = jnp.pad(self.member.rows(commands), ((0, 0), (n_held - 1, 0), (0, 0)))

            def entry(carry: tuple, at: tuple) -> tuple[tuple, jax.Array]:
                (q, newest), visited = carry, []
                index, shared = at
                recent = jax.lax.dynamic_slice_in_dim(entries, index, n_held, axis=1).reshape(n, -1)
                driven = jnp.split(recent @ by_held, n_steps, axis=-1)
                for tick, y in enumerate(driven):
                    y = y + shared[tick] + self.normalise_position(q) @ by_q
                    q, newest, _ = self.finish_step(others, y, q, newest, stops)
                    visited.append(q)
                return (q, newest), jnp.stack(visited)

            begin = tuple(jnp.broadcast_to(of, (n, *of.shape)) for of in (history.q, history.motion[-1]))
            at = (jnp.arange(n_entries), shared.reshape(n_entries, n_steps, width))
            return jax.lax.scan(entry, begin, at)[1]

        return roll_out

    def inputs(self, commands: jax.Array, q: jax.Array) -> jax.Array:
        """What the networks see of commands a_{t-k} … a_t, (..., k+1, n_joint), and q_t (..., n_joint)."""
        return jnp.concatenate([_flat(self.member.rows(commands)), self.normalise_position(q)], axis=-1)

    def integrate(self, q: jax.Array, newest: jax.Array, residual: jax.Array) -> tuple[jax.Array, jax.Array]:
        """The network's output is the velocity itself; the newest one does not matter."""
        return q + self.specification.dt_s * residual, residual

    def own_stops(self, q: jax.Array) -> Stops | None:
        """Where logs have shown them; a joint that is beyond stays where it is, or returns."""
        if not self._has_own_stops:
            return None
        lower, upper = self.specification.stops()
        return Stops(jnp.minimum(jnp.asarray(lower, q.dtype), q), jnp.maximum(jnp.asarray(upper, q.dtype), q))

    def without_own_stops(self) -> "FirModel":
        """See `StepwiseModel.without_own_stops`."""
        free = copy.copy(self)
        free._has_own_stops = False
        return free

    def _network(self) -> FirNetwork:
        return self._of(self.specification.hidden)

    def _of(self, hidden: list[int]) -> FirNetwork:
        specification = self.specification
        return FirNetwork(
            specification.n_joint,
            specification.lags,
            specification.demand_beyond,
            hidden,
            specification.n_joint,
        )

    def _split(self, layers: list[Layer]) -> list:
        """The first layer over commands alone, the other layers, and the first layer's kernel over the position."""
        first, *others = layers
        by_commands, by_q = jnp.split(first.kernel, [len(first.kernel) - self.specification.n_joint])
        return [Layer(by_commands, first.bias), *others, by_q]

    def _held_kernels(self, first: Layer, n_steps: int) -> jax.Array:
        """(n_steps, commands in the window, row, width), the acting command first."""
        n_rows, width = self.specification.lags + 1, len(first.bias)
        by_row = first.kernel.reshape(n_rows, -1)
        kernels = by_held_commands(by_row, np.arange(n_rows)[::-1], n_steps)
        return kernels.reshape(*kernels.shape[:2], self.member.row, width)


def _flat(rows: jax.Array) -> jax.Array:
    """(..., T, m) to (..., T * m), time-major."""
    return rows.reshape(*rows.shape[:-2], -1)
