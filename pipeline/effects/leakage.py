"""`leakage`: motion at zero command."""

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
    VelocityEffect,
)


class Leakage(VelocityEffect):
    """A joint creeps while its command is zero."""

    place = Place.drift
    card = Card(
        family="leakage",
        equation="v = u + s while a = 0",
        source="internal leakage of cylinder and valve: Merritt (1967), chapter 6",
        signature="constant residual velocity at rest, in one direction",
        confounded_with=("sensor_bias",),
        excitation="rests of several seconds in several poses",
        depends_on=("zero_command:{joint}",),
        scope=Scope.joint,
        complexity=1.0,
        drawn_over=Abscissa.velocity,
        counted_along=Along.axis,
        parameters=(Parameter("sag_rate", "speed", 0.0, -1.0, 1.0),),
    )

    def apply(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Add the creep."""
        return state, u + self._creep(values, signals)

    def invert(self, values: Values, state: State, v: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Take it away again."""
        return state, v - self._creep(values, signals)

    def _creep(self, values: Values, signals: Signals) -> jax.Array:
        return jnp.where(jnp.abs(signals.command) < SMALLEST_COMMAND, values["sag_rate"], 0.0)
