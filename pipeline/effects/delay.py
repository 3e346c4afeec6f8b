"""`delay`: pure transport delay added between command and actuator."""

import jax

from pipeline.effects.command_buffer import delayed, initial_buffer
from pipeline.effects.effect import Abscissa, Along, Card, CommandEffect, Parameter, Scope, State, Values


class Delay(CommandEffect):
    """The joint gets its commands later."""

    card = Card(
        family="delay",
        equation="a'(t) = a(t − θ)",
        source="dead time of pilot lines and output stages: Ljung (1999), System Identification, chapter 4",
        signature="residual pulses of equal area after every change of command: minus at starts, plus at stops",
        confounded_with=("lag", "stiction", "backlash", "timing"),
        excitation="starts and stops of single joints with holds of 1 s and more in between",
        depends_on=("command:{joint}",),
        scope=Scope.joint,
        complexity=1.0,
        drawn_over=Abscissa.since_command,
        counted_along=Along.change,
        parameters=(
            Parameter(
                "added_delay",
                "s",
                0.0,
                0.0,
                0.8,
                grid=(0.025, 0.05, 0.075, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5),
            ),
        ),
    )

    def initial(self, batch: tuple[int, ...]) -> State:
        """No commands so far."""
        return initial_buffer(batch, self.setting.n_joint)

    def apply(self, values: Values, state: State, command: jax.Array) -> tuple[State, jax.Array]:
        """The command of θ ago."""
        return delayed(state, command, values["added_delay"] / self.setting.dt_s)
