"""End stops: where joints end, and which velocity they have there."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from pipeline.dynamics.model.specification import ModelSpecification, Target


@dataclass(frozen=True)
class Stops:
    """A joint beyond a limit is at it.

    A log holds no velocity that is zero from one step to the next, because its velocities are tracked. A network takes
    such a zero for a sharp deceleration, and bounces. Predictions of logs therefore keep the network's velocity.

    Attributes:
        lower: (..., n_joint), rad or m.
        upper: (..., n_joint), rad or m.
        at_rest: Whether the velocity at a stop is zero, as in an environment; False: it is what the network says.
    """

    lower: ArrayLike
    upper: ArrayLike
    at_rest: bool = True

    @classmethod
    def of_log(cls, specification: ModelSpecification, lowest: jax.Array, highest: jax.Array) -> "Stops":
        """For predictions of a log: the joint limits, or the furthest that a joint has been beyond them.

        Args:
            specification: Of the model; its limits are taken.
            lowest: (..., n_joint), lowest configuration so far, rad or m.
            highest: (..., n_joint), highest configuration so far, rad or m.
        """
        lower = jnp.minimum(jnp.asarray(specification.position_lower, lowest.dtype), lowest)
        upper = jnp.maximum(jnp.asarray(specification.position_upper, lowest.dtype), highest)
        return cls(lower, upper, at_rest=False)

    def act(self, target: Target, q: jax.Array, newest: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Configuration q and newest row of the motion after the stops, each (..., n_joint)."""
        inside = jnp.clip(q, self.lower, self.upper)
        if target is Target.dq:
            return inside, inside
        return inside, jnp.where(inside == q, newest, 0.0) if self.at_rest else newest
