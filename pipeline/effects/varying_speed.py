"""A speed that varies as nothing that is measured explains: estimated from recent errors, and predicted to decay.

No family of the contract and never named: it corrects for `supply_variation` and for a joint's own course in time.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from pipeline.effects.effect import (
    SMALLEST_RATIO,
    Abscissa,
    Along,
    Card,
    Parameter,
    RatioEffect,
    Scope,
    Signals,
    State,
    Values,
)

FAMILY = "varying_speed"


class Estimate(NamedTuple):
    """Of the relative change of speed z.

    Attributes:
        mean: (..., n_joint).
        known: (..., n_joint, n_joint) by how much its covariance is below that of an unknown z.
    """

    mean: jax.Array
    known: jax.Array


class VaryingSpeed(RatioEffect):
    """A Kalman filter of z, which is in part common to all joints."""

    card = Card(
        family=FAMILY,
        equation="v = (1 + z) u with z an Ornstein-Uhlenbeck process, z = common + own; predicted z e^{−t/T}",
        source="Kalman (1960), A New Approach to Linear Filtering and Prediction Problems, J. Basic Eng. 82; "
        "Uhlenbeck and Ornstein (1930), On the Theory of the Brownian Motion, Phys. Rev. 36",
        signature="residual proportional to speed that wanders within seconds to minutes",
        confounded_with=("gain", "thermal_drift", "supply_variation"),
        excitation="ordinary work",
        depends_on=("latent",),
        scope=Scope.machine,
        complexity=5.0,
        drawn_over=Abscissa.time,
        counted_along=Along.motion,
        can_set_in=False,
        parameters=(
            Parameter("common_std", "1", 0.0, 0.0, 1.0),
            Parameter("own_std", "1", 0.0, 0.0, 1.0),
            Parameter("time_constant", "s", 10.0, 0.5, 600.0),
            # Of one step's displacement, which the model would miss without z.
            Parameter("noise", "length", 1.0, 0.0, 1.0),
        ),
    )
    learns_from_errors = True

    def initial(self, batch: tuple[int, ...]) -> State:
        """Nothing is known."""
        n = self.setting.n_joint
        return Estimate(self._zeros(batch), jnp.zeros((*batch, n, n)))

    def drawn(self, values: Values, key: jax.Array) -> State:
        """A z of the process, which nobody knows."""
        common, own = jax.random.split(key)
        z = values["common_std"] * jax.random.normal(common)
        z = z + values["own_std"] * jax.random.normal(own, z.shape)
        return self.initial(())._replace(mean=z)

    def ratio(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """1 + z now; z decays until the next step."""
        decay = jnp.exp(-self.setting.dt_s / values["time_constant"])
        after = Estimate(decay * state.mean, decay[..., :, None] * decay[..., None, :] * state.known)
        return after, jnp.maximum(1.0 + state.mean, SMALLEST_RATIO)

    def corrected(self, values: Values, state: State, error: jax.Array, displacement: jax.Array) -> State:
        """See `VelocityEffect.corrected`."""
        common = values["common_std"]
        usual = common[..., :, None] * common[..., None, :] + _diagonal(values["own_std"] ** 2)
        covariance = usual - state.known
        slope = displacement / jnp.maximum(1.0 + state.mean, SMALLEST_RATIO)  # of the displacement with z
        with_error = covariance * slope[..., None, :]
        of_error = slope[..., :, None] * with_error + _diagonal(values["noise"] ** 2)
        gain = jnp.swapaxes(jnp.linalg.solve(of_error, jnp.swapaxes(with_error, -1, -2)), -1, -2)
        mean = state.mean + jnp.einsum("...ij,...j->...i", gain, error)
        return Estimate(mean, state.known + gain @ jnp.swapaxes(with_error, -1, -2))


def _diagonal(values: jax.Array) -> jax.Array:
    """(..., n, n) of (..., n)."""
    return values[..., None] * jnp.eye(values.shape[-1], dtype=values.dtype)
