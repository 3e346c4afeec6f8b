"""`leakage`: motion at zero command, a share of which remains under command."""

import jax
import jax.numpy as jnp

from pipeline.effects.effect import (
    SMALLEST_COMMAND,
    Abscissa,
    Along,
    Card,
    Parameter,
    Place,
    Scope,
    Signals,
    State,
    Values,
    Variant,
    VelocityEffect,
)

# Of the creep at rest; bounds the change of load pressure through motion.
LARGEST_SHARE = 2.0


class Leakage(VelocityEffect):
    """A joint creeps at zero command; a share of the creep is added to its commanded motion."""

    place = Place.drift
    card = Card(
        family="leakage",
        equation="v = u + s (1[a = 0] + k₊ 1[a > 0] + k₋ 1[a < 0])",
        source="internal leakage of cylinder and valve: Merritt (1967), chapter 6",
        signature="constant residual velocity at rest, in one direction",
        confounded_with=("sensor_bias", "gain", "load"),
        excitation="rests of several seconds in several poses",
        depends_on=("zero_command:{joint}",),
        scope=Scope.joint,
        complexity=1.0,
        drawn_over=Abscissa.velocity,
        counted_along=Along.axis,
        parameters=(
            Parameter("sag_rate", "speed", 0.0, -1.0, 1.0),
            Parameter("share_in_positive_motion", "1", 0.0, 0.0, LARGEST_SHARE),
            Parameter("share_in_negative_motion", "1", 0.0, 0.0, LARGEST_SHARE),
        ),
    )

    def variants(self) -> list[Variant]:
        """The creep at rest."""
        return [((("sag_rate", None),),)]

    def freed_later(self) -> Variant:
        """Shares of the creep in motion, which depend on the load pressure there."""
        return ((("share_in_positive_motion", None),), (("share_in_negative_motion", None),))

    def apply(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Add the creep."""
        return state, u + self._creep(values, signals)

    def invert(self, values: Values, state: State, v: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Subtract the creep."""
        return state, v - self._creep(values, signals)

    def _creep(self, values: Values, signals: Signals) -> jax.Array:
        is_positive, is_negative = signals.command >= SMALLEST_COMMAND, signals.command <= -SMALLEST_COMMAND
        share = jnp.where(is_positive, values["share_in_positive_motion"], 1.0)
        share = jnp.where(is_negative, values["share_in_negative_motion"], share)
        return share * values["sag_rate"]
