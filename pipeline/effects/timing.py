"""`timing`: delay of the measurement channel."""

import jax

from pipeline.effects.command_buffer import delayed, initial_buffer
from pipeline.effects.effect import Abscissa, Along, Card, CommandEffect, Parameter, Scope, State, Values


class Timing(CommandEffect):
    """All readings are delayed by the same time.

    A reading at t shows the machine at t − L, which had received the commands up to t − L. In the readings, all
    commands thus act later by L. Unlike an actuator's delay it is common to all joints.
    """

    card = Card(
        family="timing",
        equation="q_measured(t) = q(t − L), all joints alike; so a'(t) = a(t − L)",
        source="time stamps taken on arrival: Olson (2010), A passive solution to the sensor synchronization problem",
        signature="as a delay, of the same length on every joint; often with irregular or missing samples",
        confounded_with=("delay",),
        excitation="starts and stops of every joint",
        depends_on=("clock",),
        scope=Scope.machine,
        complexity=1.0,
        drawn_over=Abscissa.since_command,
        counted_along=Along.change,
        parameters=(
            Parameter(
                "latency", "s", 0.0, 0.0, 0.8, grid=(0.025, 0.05, 0.075, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5)
            ),
        ),
    )

    def initial(self, batch: tuple[int, ...]) -> State:
        """No commands so far."""
        return initial_buffer(batch, self.setting.n_joint)

    def apply(self, values: Values, state: State, command: jax.Array) -> tuple[State, jax.Array]:
        """The command of L ago."""
        return delayed(state, command, values["latency"] / self.setting.dt_s)
