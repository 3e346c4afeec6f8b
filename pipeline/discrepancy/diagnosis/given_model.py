"""A given model in the diagnosis model's place: what it lacks of the logs shows in its own velocities.

In a one-step residual an effect is in the input already, as far as the model is fed measured velocities. Along logs the
given model is fed its own velocities instead, beside the measured commands and positions.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from pipeline.discrepancy.diagnosis.diagnosis_model import DiagnosisModel
from pipeline.dynamics.model.dynamics_model import DynamicsModel, Target
from pipeline.dynamics.model.features import History
from pipeline.dynamics.model.network import Parameters


@dataclass(frozen=True)
class GivenModel:
    """What `Simulation` asks of a diagnosis model.

    Attributes:
        model: The given model, of any kind.
        parameters: θ.
        identified: The diagnosis model of the same logs, which knows where joints end.
    """

    model: DynamicsModel
    parameters: Parameters
    identified: DiagnosisModel

    def velocity(self, command: jax.Array, q: jax.Array) -> jax.Array:
        """Velocity before the stops, (..., T, n_joint), of commands and positions of that shape."""
        command, q = (jnp.moveaxis(jnp.asarray(rows), -2, 0) for rows in (command, q))
        model = self.model.without_own_stops()

        def advance(history: History, row: tuple[jax.Array, jax.Array]) -> tuple[History, jax.Array]:
            command, q = row
            after = model.step(self.parameters, self._standing_at(history, q), command)
            return after, (after.q - q) / model.specification.dt_s

        _, velocity = jax.lax.scan(advance, model.initial_history(q[0]), (command, q))
        return jnp.moveaxis(velocity, 0, -2)

    def members_velocity(self, command: jax.Array, q: jax.Array) -> jax.Array:
        """The same as of a single member, (1, ..., T, n_joint)."""
        return self.velocity(command, q)[None]

    def stopped(self, velocity: jax.Array, q: jax.Array) -> jax.Array:
        """The velocity, as far as the stops allow."""
        return self.identified.stopped(velocity, q)

    def _standing_at(self, history: History, q: jax.Array) -> History:
        """The history with the measured position, and the motion that the model has predicted before."""
        if (
            self.model.specification.target is Target.dq
        ):  # a window of positions: its differences are the motion
            return history._replace(motion=history.motion + (q - history.q)[..., None, :], q=q)
        return history._replace(q=q)
