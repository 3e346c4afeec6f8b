"""`gain`: an actuator is faster or slower than it was, possibly in one direction only."""

import jax

from pipeline.effects.effect import (
    Abscissa,
    Along,
    Card,
    Parameter,
    Place,
    RatioEffect,
    Scope,
    Signals,
    State,
    Values,
    Variant,
    direction_weights,
)


class Gain(RatioEffect):
    """Speed ratio per direction of motion."""

    place = Place.speed
    parsimony = 0.1  # most actuators change in one direction, or equally in both
    card = Card(
        family="gain",
        equation="v = r₊ u for u > 0, r₋ u for u < 0",
        source="orifice equation, flow by metering area: Merritt (1967), Hydraulic Control Systems, chapter 3",
        signature="residual proportional to speed in the affected direction, whatever the place, time or other joints",
        confounded_with=("load", "sensor_bias", "thermal_drift", "lag"),
        excitation="long single-joint moves in both directions, in several poses, up to both stops",
        depends_on=("command:{joint}",),
        scope=Scope.joint,
        complexity=1.0,
        drawn_over=Abscissa.velocity,
        counted_along=Along.axis,
        parameters=(
            Parameter("ratio_positive", "1", 1.0, 0.2, 2.5),
            Parameter("ratio_negative", "1", 1.0, 0.2, 2.5),
        ),
    )

    def variants(self) -> list[Variant]:
        """One direction, both equally, both independently."""
        positive, negative = ("ratio_positive", None), ("ratio_negative", None)
        return [((positive,),), ((negative,),), ((positive, negative),), ((positive,), (negative,))]

    def ratio(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Speed ratio in the direction of motion."""
        positive, negative = direction_weights(u)
        change = (values["ratio_positive"] - 1.0) * positive + (values["ratio_negative"] - 1.0) * negative
        return state, 1.0 + change
