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
    """Of the filter, (..., n_joint): its output velocity and the rate of that."""

    velocity: jax.Array
    rate: jax.Array


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
        return Mode(self._zeros(batch), self._zeros(batch))

    def apply(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Filter the velocity."""
        omega = 2.0 * jnp.pi * values["frequency"]
        zeta = jnp.clip(values["damping_ratio"], 0.0, 0.99)
        damped = omega * jnp.sqrt(1.0 - zeta**2)
        dt_s = self.setting.dt_s
        decay = jnp.exp(-zeta * omega * dt_s)
        cosine, sine = jnp.cos(damped * dt_s), jnp.sin(damped * dt_s)
        away = state.velocity - u
        velocity = u + decay * (away * (cosine + zeta * omega / damped * sine) + state.rate * sine / damped)
        rate = decay * (
            state.rate * (cosine - zeta * omega / damped * sine) - away * omega**2 / damped * sine
        )
        return Mode(velocity, rate), u + values["share"] * (velocity - u)

    def invert(self, values: Values, state: State, v: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """The mode shows in the measured velocity; what drives it is taken for the same, without the ringing."""
        rate = (v - state.velocity) / self.setting.dt_s
        return Mode(v, rate), v
