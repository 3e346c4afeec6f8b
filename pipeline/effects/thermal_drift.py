"""`thermal_drift`: speed changes with time since start while the oil warms."""

import jax
import jax.numpy as jnp

from pipeline.effects.effect import Card, Parameter, RatioEffect, Scope, Signals, State, Values


class ThermalDrift(RatioEffect):
    """Slow when cold, on all joints with one time constant."""

    card = Card(
        family="thermal_drift",
        equation="v = u (1 + w − c e^{−t/T}), t since the start of the log; w: the nominal logs' own mean loss",
        source="Newton's law of cooling; viscosity by Walther's equation (ASTM D341)",
        signature="residual proportional to speed that decays within minutes of every start, on all joints",
        confounded_with=("gain", "supply_variation"),
        excitation="ten minutes of ordinary work after a cold start",
        depends_on=("time_since_start",),
        scope=Scope.machine,
        parameters=(
            Parameter("cold_speed_loss", "1", 0.0, -0.5, 0.8),
            Parameter("warm_gain", "1", 0.0, -0.5, 0.5),
            Parameter(
                "time_constant",
                "s",
                300.0,
                20.0,
                2000.0,
                grid=(40.0, 80.0, 140.0, 220.0, 330.0, 500.0, 800.0, 1300.0),
            ),
        ),
    )

    def ratio(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Ratio at the time since start."""
        decay = jnp.exp(-signals.time_s[..., None] / values["time_constant"])
        return state, 1.0 + values["warm_gain"] - values["cold_speed_loss"] * decay
