"""The learned dynamics model (paper, section "Learning a model for the hydraulic arm actuators"), step by step.

Δq (Eq. general_model_form): q_{t+1} = q_t + f_θ(x̃_t).
Δq̇ (Eqs. vel_prediction, pos_prediction): new velocity = newest velocity in the window + f'_θ(x̃_t);
q_{t+1} = q_t + Δt · new velocity.

The model is pure: it clips nothing, as the paper's equations do not. Whoever needs joint limits (an
environment) gives stops.
"""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.dynamics import Dynamics, MeasuredHistory
from pipeline.dynamics.model.features import History, approximate_state, min_max, push
from pipeline.dynamics.model.network import (
    KolmogorovArnoldNetwork,
    Layer,
    MultilayerPerceptron,
    Network,
    Parameterization,
    Parameters,
    apply,
)
from pipeline.dynamics.model.specification import ModelSpecification, Target
from pipeline.dynamics.model.stops import Stops


class StepwiseModel(Dynamics[Parameters, History]):
    """f_θ around its network. `step` is the definition, `finish_step` the end of every faster way."""

    has_hidden_state = False

    def __init__(self, specification: ModelSpecification) -> None:
        self.specification = specification
        self.network: Network = self._network()

    def initialise(self, key: jax.Array) -> Parameters:
        """Draw the parameters θ; `key` is consumed."""
        return self.network.initialise(key)

    def initial_history(self, q: jax.Array) -> History:
        """History of a machine that has been at rest in `q` (..., n_joint): no motion, no commands."""
        rows = (*q.shape[:-1], self.specification.lags + 1, q.shape[-1])
        motion = jnp.zeros(rows, q.dtype)
        if self.specification.target is Target.dq:
            motion = jnp.broadcast_to(q[..., None, :], rows)
        return History(motion=motion, commands=jnp.zeros(rows, q.dtype), q=q)

    def features(self, history: MeasuredHistory) -> jax.Array:
        """The policy's x̃_t, (..., 2n(k+1) + n): commands up to a_{t-1}."""
        return approximate_state(
            self.normalise_motion(history.motion), history.commands, self.normalise_position(history.q)
        )

    def step(
        self, parameters: Parameters, history: History, command: jax.Array, stops: Stops | None = None
    ) -> History:
        """See `Dynamics.step`: the new velocity (or position) is appended to `motion`, a_t to `commands`."""
        history = history._replace(commands=push(history.commands, command))
        residual = self.scale_residual(apply(self.network, parameters, self.features(history)))
        q, newest = self._moved(history.q, history.motion[..., -1, :], residual, stops)
        return History(motion=push(history.motion, newest), commands=history.commands, q=q)

    def finish_step(
        self,
        others: Sequence[Layer],
        y: jax.Array,
        q: jax.Array,
        newest: jax.Array,
        stops: Stops | None = None,
        of_output: Callable[[int, jax.Array], jax.Array] = lambda number, y: y,
    ) -> tuple[jax.Array, jax.Array, list[jax.Array]]:
        """A step from the first layer's output on; faster ways differ in how they arrive there.

        Args:
            others: The network's layers but the first.
            y: First layer's output, (..., width).
            q: At t, (..., n_joint), rad or m.
            newest: Newest row of the motion at t, (..., n_joint).
            stops: Where joints end; None: they do not.
            of_output: What goes on of a layer's number and output.

        Returns:
            q and the newest row of the motion at t+1, and the inputs of `others`, expanded.
        """
        # Where there is a gradient, expanding again on the way back is cheaper than keeping what it is made of.
        activate, inputs = jax.checkpoint(self.network.activate, prevent_cse=False), []
        for number, layer in enumerate(others):
            inputs.append(activate(of_output(number, y)))
            y = inputs[-1] @ layer.kernel + layer.bias
        residual = self.scale_residual(of_output(len(others), y))
        return *self._moved(q, newest, residual, stops), inputs

    def integrate(self, q: jax.Array, newest: jax.Array, residual: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Next configuration and next row of `motion` from the newest row and the residual."""
        if self.specification.target is Target.dq:
            q = q + residual
            return q, q
        velocity = newest + residual
        return q + self.specification.dt_s * velocity, velocity

    def _moved(
        self, q: jax.Array, newest: jax.Array, residual: jax.Array, stops: Stops | None
    ) -> tuple[jax.Array, jax.Array]:
        moved = self.integrate(q, newest, residual)
        for each in (self.own_stops(q), stops):
            moved = moved if each is None else each.act(self.specification.target, *moved)
        return moved

    def own_stops(self, q: jax.Array) -> Stops | None:
        """End stops that are part of the model, for a step that begins in `q` (..., n_joint); None: it has none."""
        return None

    def without_own_stops(self) -> "StepwiseModel":
        """The same model, whose steps end at no stops but those that they are given."""
        return self

    def scale_residual(self, output: jax.Array) -> jax.Array:
        """Network output (..., n_joint) in units of position (dq) or velocity (dqdot)."""
        return output * jnp.asarray(np.asarray(self.specification.residual_scale), output.dtype)

    def normalise_motion(self, motion: jax.Array) -> jax.Array:
        """Min-max of the window's rows: by velocity limits (dqdot) or joint limits (dq)."""
        if self.specification.target is Target.dq:
            return self.normalise_position(motion)
        limit = np.asarray(self.specification.velocity_limit)
        return min_max(motion, -limit, limit)

    def _network(self) -> Network:
        specification = self.specification
        n_in, n_out = specification.n_features, specification.n_joint
        if specification.parameterization is Parameterization.mlp:
            return MultilayerPerceptron(n_in, specification.hidden, n_out)
        return KolmogorovArnoldNetwork(n_in, specification.hidden, n_out, specification.legendre_degree)
