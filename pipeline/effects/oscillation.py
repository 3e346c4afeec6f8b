"""`oscillation`: a lightly damped resonance between drive and link."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from pipeline.effects.effect import (
    Abscissa,
    Along,
    Card,
    Parameter,
    Place,
    Scope,
    Signals,
    State,
    Values,
    VelocityEffect,
)


class Mode(NamedTuple):
    """State of the filter, (..., n_joint).

    Attributes:
        velocity: Output.
        rate: Time derivative of the output.
        drive: Estimated input.
        covariance: (..., n_joint, 3, 3) of velocity, rate and drive, in units of the joint's speed.
    """

    velocity: jax.Array
    rate: jax.Array
    drive: jax.Array
    covariance: jax.Array


class Oscillation(VelocityEffect):
    """The velocity follows through a second-order resonance."""

    place = Place.response
    card = Card(
        family="oscillation",
        equation="ẍ = ω² (u − x) − 2 ζ ω ẋ, v = u + s (x − u); discretised exactly for u held; s = 1 in full",
        source="oil column and structure as one spring: Merritt (1967), chapter 6; exact discretisation: Åström and "
        "Wittenmark (1997), Computer-Controlled Systems, chapter 2",
        signature="the velocity rings after starts and stops at a frequency of its own",
        confounded_with=("lag",),
        excitation="hard stops from full speed, followed by rest",
        depends_on=("time_since_stop:{joint}",),
        scope=Scope.joint,
        complexity=2.5,
        drawn_over=Abscissa.since_command,
        counted_along=Along.change,
        parameters=(
            Parameter("share", "1", 0.0, 0.0, 1.5),
            Parameter(
                "frequency",
                "Hz",
                1.5,
                0.3,
                8.0,
                grid=(0.6, 0.8, 1.0, 1.25, 1.5, 1.8, 2.2, 2.7, 3.3, 4.0, 5.0),
            ),
            Parameter("damping_ratio", "1", 0.1, 0.01, 0.9, grid=(0.05, 0.1, 0.2, 0.35)),
        ),
    )

    def initial(self, batch: tuple[int, ...]) -> State:
        """At rest."""
        rest = self._zeros(batch)
        return Mode(rest, rest, rest, jnp.zeros((*rest.shape, 3, 3), rest.dtype))

    def apply(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Filter the velocity."""
        a, b, c, d = self._transition(values)
        away = state.velocity - u
        velocity = u + a * away + b * state.rate
        rate = c * away + d * state.rate
        return state._replace(velocity=velocity, rate=rate, drive=u), u + values["share"] * (velocity - u)

    def invert(self, values: Values, state: State, v: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Kalman filter of the mode with a random walk as input, because the exact inverse amplifies noise."""
        a, b, c, d = self._transition(values)
        zero, one = jnp.zeros_like(a), jnp.ones_like(a)
        transition = jnp.stack(
            [jnp.stack(row, axis=-1) for row in ([a, b, one - a], [c, d, -c], [zero, zero, one])], axis=-2
        )
        scale = self.setting.speed_scale
        mean = jnp.stack([state.velocity, state.rate, state.drive], axis=-1) / scale[:, None]
        mean = jnp.einsum("...ij,...j->...i", transition, mean)
        covariance = transition @ state.covariance @ jnp.swapaxes(transition, -1, -2)
        covariance = covariance + jnp.diag(jnp.asarray([0.0, 0.0, DRIVE_STEP**2], covariance.dtype))
        along = covariance[..., 0] / (covariance[..., :1, 0] + VELOCITY_NOISE**2)
        mean = mean + along * (v / scale - mean[..., 0])[..., None]
        covariance = covariance - along[..., None] * covariance[..., :1, :]
        velocity, rate, drive = jnp.moveaxis(mean * scale[:, None], -1, 0)
        return Mode(velocity, rate, drive, covariance), v + values["share"] * (drive - v)

    def _transition(self, values: Values) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
        """Transition matrix of (velocity - drive, rate) over one step, row by row, (n_joint,) each."""
        omega = 2.0 * jnp.pi * values["frequency"]
        zeta = jnp.clip(values["damping_ratio"], 0.0, 0.99)
        damped = omega * jnp.sqrt(1.0 - zeta**2)
        dt_s = self.setting.dt_s
        decay = jnp.exp(-zeta * omega * dt_s)
        cosine, sine = jnp.cos(damped * dt_s), jnp.sin(damped * dt_s)
        return (
            decay * (cosine + zeta * omega / damped * sine),
            decay * sine / damped,
            -decay * omega**2 / damped * sine,
            decay * (cosine - zeta * omega / damped * sine),
        )


# Shares of full speed: standard deviations of the drive's change per step, and of a measured velocity.
DRIVE_STEP = 0.3
VELOCITY_NOISE = 0.01
