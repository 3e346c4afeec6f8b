"""`lag`: the response is slower (or faster) by a first-order time constant; not a delay."""

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


class Filter(NamedTuple):
    """Velocities of the last step, (..., n_joint)."""

    u: jax.Array
    v: jax.Array


class Lag(VelocityEffect):
    """First-order lag on the velocity; a negative time constant is its inverse, a lead."""

    place = Place.response
    card = Card(
        family="lag",
        equation="τ v̇ = u − v for τ > 0, with σ τ instead of τ while slowing down, discretised backwards; "
        "v = u + |τ| u̇ for τ < 0",
        source="spool and pressure build-up as one lag: Jelali and Kroll (2003), Hydraulic Servo-systems",
        signature="residual decays over about τ after each change of command, with zero area over start and stop",
        confounded_with=("delay", "oscillation", "stiction"),
        excitation="starts and stops of single joints with holds of 1 s and more in between",
        depends_on=("command:{joint}",),
        scope=Scope.joint,
        complexity=1.0,
        drawn_over=Abscissa.since_command,
        counted_along=Along.change,
        parameters=(
            Parameter(
                "added_time_constant",
                "s",
                0.0,
                -0.5,
                2.0,
                grid=(-0.3, -0.2, -0.12, -0.06, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.9),
            ),
            # A delay at starts alone indicates stiction or backlash, not a slow response.
            Parameter("fall_share", "1", 1.0, 0.15, 2.0, grid=(1.0, 0.25)),
        ),
    )

    def initial(self, batch: tuple[int, ...]) -> State:
        """At rest."""
        return Filter(self._zeros(batch), self._zeros(batch))

    def apply(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Move v towards u."""
        slow, spread = self._factors(values, (u - state.v) * state.v < 0.0)
        slower = u + slow / (1.0 + slow) * (state.v - u)
        faster = u + spread * (u - state.u)
        v = jnp.where(values["added_time_constant"] > 0.0, slower, faster)
        v = jnp.where(values["added_time_constant"] == 0.0, u, v)
        return Filter(u, v), v

    def invert(self, values: Values, state: State, v: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """The inverse of a lag is a lead, and vice versa."""
        slow, spread = self._factors(values, (v - state.v) * state.v < 0.0)
        of_lag = v + slow * (v - state.v)
        of_lead = (v + spread * state.u) / (1.0 + spread)
        u = jnp.where(values["added_time_constant"] > 0.0, of_lag, of_lead)
        u = jnp.where(values["added_time_constant"] == 0.0, v, u)
        return Filter(u, v), u

    def _factors(self, values: Values, is_falling: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Lag and lead, in steps.

        With backward discretisation, a lag loses τ times the speed at a start for any step length. Velocities are means
        over a step. The form e^(-Δt/τ), for u held and v at the step's end, would lose Δt/2 times the speed less, which
        would bias τ by Δt/2.
        """
        tau_steps = values["added_time_constant"] / self.setting.dt_s
        slow = jnp.maximum(tau_steps * jnp.where(is_falling, values["fall_share"], 1.0), 0.0)
        return slow, jnp.maximum(-tau_steps, 0.0)
