"""`backlash`: lost motion on reversal."""

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


class Backlash(VelocityEffect):
    """The play operator on the motion."""

    place = Place.play
    card = Card(
        family="backlash",
        equation="play operator of width w: the drive crosses from -w/2 to w/2 of the link before the link follows",
        source="Nordin and Gutman (2002), Controlling mechanical systems with backlash, Automatica 38",
        signature="the first w of motion after every reversal is missing; starts in the same direction stay",
        confounded_with=("stiction", "delay"),
        excitation="reversals, and repeated starts in the same direction",
        depends_on=("reversal:{joint}",),
        scope=Scope.joint,
        complexity=1.2,
        drawn_over=Abscissa.since_command,
        counted_along=Along.change,
        parameters=(
            Parameter(
                "width",
                "length",
                0.0,
                0.0,
                0.3,
                grid=(0.005, 0.01, 0.015, 0.02, 0.03, 0.04, 0.055, 0.075, 0.1),
            ),
        ),
    )

    def initial(self, batch: tuple[int, ...]) -> State:
        """The drive lies in the middle of its play."""
        return self._zeros(batch)

    def apply(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Motion inside the gap is lost."""
        half = 0.5 * values["width"]
        moved = jnp.clip(state + self.setting.dt_s * u, -half, half)
        return moved, u - (moved - state) / self.setting.dt_s

    def invert(self, values: Values, state: State, v: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """While the link moves, the drive touches the leading flank; its motion inside the gap is not observable."""
        threshold = MOVING_SHARE * self.setting.speed_scale
        half = 0.5 * values["width"]
        return jnp.where(v > threshold, half, jnp.where(v < -threshold, -half, state)), v

    def ahead(self, values: Values, state: State) -> jax.Array:
        """The drive's position in the gap: it reaches a stop half a width before the link's readings."""
        return state


MOVING_SHARE = 0.05  # of full speed; above it the link follows the drive
