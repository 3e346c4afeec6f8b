"""`thermal_drift`: speed changes with time since start while the oil warms."""

import jax
import jax.numpy as jnp

from pipeline.effects.effect import (
    SMALLEST_RATIO,
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

EQUALLY_LATE = 1.0  # same lag at stops and starts
EQUALLY_LONG = 1.0  # same duration as the loss of speed
# Two stages, a line and its spool, have zero initial slope. A single stage reacts at once, and would fit a late start
# with a longer lag and a higher speed.
N_STAGES = 2


class ThermalDrift(VelocityEffect):
    """Lower speed and slower response when cold, on all joints with one time constant."""

    place = Place.speed
    of_the_machine = ("time_constant", "fall_share", "lag_time_ratio")
    parsimony = 0.015  # at most 0.011 is lost between neighbouring time constants of the grid
    card = Card(
        family="thermal_drift",
        equation="v = w₂ (1 + g − c e^{−t/T}) with ½ l e^{−t/κT} ẇ₁ = u − w₁ and ½ l e^{−t/κT} ẇ₂ = w₁ − w₂, σ l "
        "instead of l while slowing down, discretised backwards; t since the log began; g: the nominal logs' mean loss",
        source="Newton's law of cooling; viscosity by Walther's equation (ASTM D341), which thins the flow and makes "
        "pressures build up later",
        signature="residual proportional to speed that decays within minutes of every start, on all joints",
        confounded_with=("gain", "supply_variation"),
        excitation="ten minutes of ordinary work after a cold start",
        depends_on=("time_since_start",),
        scope=Scope.machine,
        complexity=2.5,
        drawn_over=Abscissa.time,
        counted_along=Along.motion,
        can_set_in=False,
        parameters=(
            Parameter("cold_speed_loss", "1", 0.0, -0.5, 0.8),
            Parameter("warm_gain", "1", 0.0, -0.5, 0.5),
            Parameter("cold_lag", "s", 0.0, 0.0, 2.0),
            # Springs empty a pilot line faster than its pump fills it, so stops are less delayed than starts.
            Parameter("fall_share", "1", 1.0, 0.15, 2.0),
            # Loss of speed follows the remaining pressure; lag is proportional to viscosity and lasts longer.
            Parameter("lag_time_ratio", "1", 1.0, 1.0, 6.0, natural_bounds=True),
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

    def variants(self) -> list[Variant]:
        """The cold loss, the warm gain, or both; a lag of all joints alone may come from the measurement channel.

        The cold loss alone suits nominal logs without drift: logs hardly longer than the time constant do not
        determine three values. The warm gain alone covers a permanent change of speed, which is not drift.
        """
        cold, warm = (("cold_speed_loss", None),), (("warm_gain", None),)
        return [(cold,), (warm,), (cold, warm)]

    def freed_later(self) -> Variant:
        """The lag of cold oil, and the speed loss on other joints."""
        return ((("cold_speed_loss", None),), (("cold_lag", None),))

    def fitted_later(self) -> dict[str, float]:
        """Lag of stops relative to starts, and its duration, which are identifiable only with a lag."""
        return {"fall_share": EQUALLY_LATE, "lag_time_ratio": EQUALLY_LONG}

    def freed_beside_nominal(self) -> Variant:
        """The mean loss of the nominal logs, which the frozen model contains."""
        return ((("warm_gain", None),),)

    def initial(self, batch: tuple[int, ...]) -> State:
        """At rest: w₁ and w₂, (..., n_joint) each."""
        return (self._zeros(batch),) * N_STAGES

    def apply(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Delay and reduce the velocity."""
        ratio, lag_steps = self._at(values, signals)
        w, stages = u, []
        for since in state:
            lag = self._when(values, lag_steps, w, since)
            # Written as a change of u, so that neutral values are exactly the identity.
            w = w - lag / (1.0 + lag) * (w - since)
            stages.append(w)
        return tuple(stages), ratio * w

    def invert(self, values: Values, state: State, v: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """The inverse of a lag is a lead."""
        ratio, lag_steps = self._at(values, signals)
        w, stages = v / jnp.maximum(ratio, SMALLEST_RATIO), []
        for since in reversed(state):
            stages.append(w)
            w = w + self._when(values, lag_steps, w, since) * (w - since)
        return tuple(reversed(stages)), w

    def _at(self, values: Values, signals: Signals) -> tuple[jax.Array, jax.Array]:
        """Speed ratio, and lag of each stage at starts in steps, at the time since start."""
        times = signals.time_s[..., None] / values["time_constant"]
        ratio = 1.0 + values["warm_gain"] - values["cold_speed_loss"] * jnp.exp(-times)
        lag_steps = values["cold_lag"] / (N_STAGES * self.setting.dt_s)
        return ratio, lag_steps * jnp.exp(-times / values["lag_time_ratio"])

    @staticmethod
    def _when(values: Values, lag_steps: jax.Array, to: jax.Array, since: jax.Array) -> jax.Array:
        """The lag during a change from one speed to another."""
        return lag_steps * jnp.where((to - since) * since < 0.0, values["fall_share"], 1.0)
