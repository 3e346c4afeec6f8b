"""`load`: speed depends on configuration: gravity, payload."""

import jax
import jax.numpy as jnp

from pipeline.effects.effect import (
    Abscissa,
    Along,
    Card,
    Parameter,
    RatioEffect,
    Scope,
    Signals,
    State,
    Values,
    direction_weights,
)


class Load(RatioEffect):
    """A load slows motion against it and speeds up motion along it, by an amount that depends on the pose."""

    card = Card(
        family="load",
        equation="v_j = u_j (r_j± − sign(u_j) Σ_i h_ji q̄_i), r± per direction, q̄ the position in [-1, 1] of the range",
        source="pressure drop over the metering edge less load pressure: Merritt (1967), chapter 5; linear in the pose",
        signature="slower one way, faster the other way, by an amount that changes with the joints' positions",
        confounded_with=("gain", "sensor_bias"),
        excitation="moves in both directions with the other joints stretched and folded",
        depends_on=("position",),
        scope=Scope.joint,
        complexity=3.0,
        drawn_over=Abscissa.position,
        counted_along=Along.axis,
        parameters=(
            Parameter("mean_speed_ratio_up", "1", 1.0, 0.2, 2.0),
            Parameter("mean_speed_ratio_down", "1", 1.0, 0.2, 2.0),
            Parameter("load_slope", "1", 0.0, -0.8, 0.8, per_source=True),
        ),
    )

    def ratio(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """One minus the load in the direction of motion."""
        middle = 0.5 * (self.setting.upper + self.setting.lower)
        place = (signals.q - middle) / (0.5 * (self.setting.upper - self.setting.lower))
        slope = jnp.einsum("...i,...ji->...j", place, values["load_slope"])
        positive, negative = direction_weights(u)
        change = (values["mean_speed_ratio_up"] - 1.0 - slope) * positive
        change = change + (values["mean_speed_ratio_down"] - 1.0 + slope) * negative
        return state, 1.0 + jnp.clip(change, -0.9, 1.5)
