"""`other:dead_band`: proportional commands below a threshold move nothing, those above it less.

The contract has no family for it, as discrete commands cannot show it: it is reported as `other`, a dependence on the
joint's own command.
"""

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


class DeadBand(CommandEffect):
    """A dead band per direction, beyond whatever the nominal machine has; full commands stay full."""

    needs_proportional_commands: ClassVar[bool] = True
    reaches_other_joints: ClassVar[bool] = True
    place = Place.command_size
    card = Card(
        family="other:dead_band",
        equation="a' = sign(a) max(0, (|a| − d) / (1 − d)), d = d₋ for a < 0, d₊ for a > 0",
        source="overlapped spool: Merritt (1967), Hydraulic Control Systems, chapter 5; "
        "Tao and Kokotović (1994), Adaptive control of plants with unknown dead-zones",
        signature="what moved at small commands stands still, full commands as before; other joints no longer lose the "
        "flow of commands that move nothing",
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
        ),
    )

    def grid(self) -> list[dict[str, float]]:
        """All pairs of values but that of no dead band at all."""
        return [point for point in super().grid() if any(point.values())]

    def apply(self, values: Values, state: State, command: jax.Array) -> tuple[State, jax.Array]:
        """What is left of the commands beyond the band."""
        band = jnp.where(command < 0.0, values["dead_band_negative"], values["dead_band_positive"])
        left = jnp.maximum(jnp.abs(command) - band, 0.0) / (1.0 - band)
        return state, jnp.sign(command) * left
