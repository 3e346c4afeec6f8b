"""`end_cushion`: a slow zone near a limit."""

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
    Variant,
    direction_weights,
)


class EndCushion(RatioEffect):
    """A joint slows down near a limit, but only in the direction of the limit."""

    card = Card(
        family="end_cushion",
        equation="v = u (1 − (1 − m) (1 − d/L)₊) towards the limit, d the distance to it",
        source="Schwartz, de Negri and Climaco (2005), Modeling and analysis of an auto-adjustable stroke end "
        "cushioning device for hydraulic cylinders; linear in the distance",
        signature="residual only near one limit and only towards it, growing with nearness",
        confounded_with=("load", "sensor_bias"),
        excitation="slow and fast approaches to both limits",
        depends_on=("position:{joint}",),
        scope=Scope.joint,
        complexity=2.0,
        drawn_over=Abscissa.position,
        counted_along=Along.axis,
        parameters=(
            Parameter("loss_upper", "1", 0.0, 0.0, 0.95, natural_bounds=True),
            Parameter("loss_lower", "1", 0.0, 0.0, 0.95, natural_bounds=True),
            Parameter(
                "zone_share", "1", 0.15, 0.01, 0.5, grid=(0.03, 0.05, 0.08, 0.11, 0.15, 0.2, 0.26, 0.33)
            ),
        ),
    )

    def variants(self) -> list[Variant]:
        """The lower or the upper limit."""
        return [((("loss_upper", None),),), ((("loss_lower", None),),)]

    def ratio(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """One minus the loss near the approached limit."""
        span = self.setting.upper - self.setting.lower
        zone = values["zone_share"] * span
        positive, negative = direction_weights(u)
        near_upper = jnp.clip(1.0 - (self.setting.upper - signals.q) / zone, 0.0, 1.0)
        near_lower = jnp.clip(1.0 - (signals.q - self.setting.lower) / zone, 0.0, 1.0)
        loss = values["loss_upper"] * near_upper * positive + values["loss_lower"] * near_lower * negative
        return state, 1.0 - loss
