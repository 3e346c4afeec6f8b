"""`stiction`: late or failed start after rest."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from pipeline.effects.effect import (
    SMALLEST_COMMAND,
    Abscissa,
    Along,
    Card,
    CommandEffect,
    Parameter,
    Scope,
    State,
    Values,
)


class Rest(NamedTuple):
    """Per joint (..., n_joint), s.

    Attributes:
        rest_s: Duration of the present rest, or of the rest before the present motion.
        moving_s: Duration of the present motion's command; 0 at rest.
    """

    rest_s: jax.Array
    moving_s: jax.Array


class Stiction(CommandEffect):
    """After a rest longer than the threshold, the command acts only after some extra time.

    A lock grows while the spool rests; it reaches half of its strength after a rest of the threshold.
    """

    card = Card(
        family="stiction",
        equation="a'(t) = 0 for the first T_s r³ / (r³ + T_r³) of a command that follows a rest of r, a(t) else",
        source="hydraulic lock of silted spools: Merritt (1967), 11-4; Armstrong-Hélouvry et al. (1994), rising static "
        "friction",
        signature="negative residual pulse after starts from rest only; stops and reversals stay as they were",
        confounded_with=("delay", "lag", "backlash"),
        excitation="starts after rests of 0.2 s to 5 s, and starts without rest",
        depends_on=("rest_time:{joint}",),
        scope=Scope.joint,
        complexity=1.5,
        drawn_over=Abscissa.since_command,
        counted_along=Along.change,
        parameters=(
            Parameter("mean_extra_time", "s", 0.0, 0.0, 1.5, grid=(0.05, 0.1, 0.2, 0.3, 0.45, 0.65)),
            Parameter("rest_threshold", "s", 0.5, 0.15, 10.0, grid=(0.2, 0.6, 1.5, 3.0), natural_bounds=True),
        ),
    )

    def initial(self, batch: tuple[int, ...]) -> State:
        """After a long rest."""
        long_ago = self._zeros(batch) + LONG_S
        return Rest(long_ago, jnp.zeros_like(long_ago))

    def apply(self, values: Values, state: State, command: jax.Array) -> tuple[State, jax.Array]:
        """Hold the command back while the extra time lasts."""
        dt_s = self.setting.dt_s
        is_zero = jnp.abs(command) < SMALLEST_COMMAND
        was_moving = state.moving_s > 0.0
        rest_s = jnp.where(is_zero, jnp.where(was_moving, dt_s, state.rest_s + dt_s), state.rest_s)
        moving_s = jnp.where(is_zero, 0.0, state.moving_s + dt_s)
        rested = 1.0 / (1.0 + (values["rest_threshold"] / jnp.maximum(rest_s, dt_s)) ** STEEPNESS)
        extra_s = rested * values["mean_extra_time"]
        passed = jnp.clip((moving_s - extra_s) / dt_s, 0.0, 1.0)
        return Rest(rest_s, moving_s), command * jnp.where(is_zero, 1.0, passed)


LONG_S = 60.0
STEEPNESS = 3  # between a sharp threshold and a lock that grows as 1 - exp(-r / T)
