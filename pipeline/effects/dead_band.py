"""`other:dead_band`: a dead band and a saturation of proportional commands.

The contract lacks a family for it, as discrete commands do not excite it. It is reported as `other`, a dependence on
the joint's own command.
"""

from itertools import product
from typing import ClassVar

import jax
import jax.numpy as jnp

from pipeline.effects.effect import (
    Abscissa,
    Along,
    Card,
    CommandEffect,
    Parameter,
    Place,
    Scope,
    State,
    Values,
)

GRID = (0.0, 0.15, 0.3, 0.45, 0.6)
WIDEST = 0.9
UNSATURATED, SATURATED, LOWEST = 1.0, (0.5, 0.75), 0.3
STEEPEST = 0.25  # narrowest range between dead band and saturation on the grid
NARROWEST = 0.05  # lower bound of that range in the model


class DeadBand(CommandEffect):
    """A dead band and a saturation per direction, in addition to the nominal machine's; full commands stay full."""

    needs_proportional_commands: ClassVar[bool] = True
    reaches_other_joints: ClassVar[bool] = True
    place = Place.command_size
    card = Card(
        family="other:dead_band",
        equation="a' = sign(a) min(1, max(0, (|a| − d) / (s − d))), d = d₋, s = s₋ for a < 0, d₊, s₊ for a > 0",
        source="overlapped spool: Merritt (1967), Hydraulic Control Systems, chapter 5; "
        "Tao and Kokotović (1994), Adaptive control of plants with unknown dead-zones",
        signature="what moved at small commands stands still, large ones are as full ones, which are as before; other "
        "joints no longer lose the flow of commands that move nothing",
        confounded_with=("gain", "other:velocity", "other:command"),
        excitation="slow ramps of single joints' commands from zero to full and back, both ways",
        depends_on=("command:{joint}",),
        scope=Scope.joint,
        complexity=2.5,
        drawn_over=Abscissa.command,
        counted_along=Along.axis,
        can_set_in=False,
        parameters=(
            Parameter("dead_band_negative", "1", 0.0, 0.0, WIDEST, grid=GRID),
            Parameter("dead_band_positive", "1", 0.0, 0.0, WIDEST, grid=GRID),
            Parameter(
                "saturation_negative", "1", UNSATURATED, LOWEST, UNSATURATED, SATURATED, natural_bounds=True
            ),
            Parameter(
                "saturation_positive", "1", UNSATURATED, LOWEST, UNSATURATED, SATURATED, natural_bounds=True
            ),
        ),
    )

    def grid(self) -> list[dict[str, float]]:
        """All pairs of bands except zero in both directions; with a saturation, equal bands in both directions."""
        unsaturated = [(*bands, UNSATURATED, UNSATURATED) for bands in product(GRID, GRID) if any(bands)]
        saturated = [(d, d, s, s) for d, s in product(GRID, SATURATED) if s - d >= STEEPEST]
        names = [parameter.name for parameter in self.card.parameters]
        return [dict(zip(names, point, strict=True)) for point in (*unsaturated, *saturated)]

    def apply(self, values: Values, state: State, command: jax.Array) -> tuple[State, jax.Array]:
        """The commands beyond the band, rescaled and limited."""
        band, full = (
            jnp.where(command < 0.0, values[f"{name}_negative"], values[f"{name}_positive"])
            for name in ("dead_band", "saturation")
        )
        left = jnp.maximum(jnp.abs(command) - band, 0.0) / jnp.maximum(full - band, NARROWEST)
        return state, jnp.sign(command) * jnp.minimum(left, 1.0)
