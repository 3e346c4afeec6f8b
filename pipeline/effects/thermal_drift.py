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

EQUALLY_LATE = 1.0  # at stops as at starts


class ThermalDrift(VelocityEffect):
    """Slow when cold, and slow to respond, on all joints with one time constant."""

    place = Place.speed
    of_the_machine = ("time_constant", "fall_share")
    parsimony = 0.015  # at most 0.011 is lost between two time constants of the grid
    card = Card(
        family="thermal_drift",
        equation="v = w (1 + g − c e^{−t/T}) with l e^{−t/T} ẇ = u − w, σ l instead of l while slowing down, "
        "discretised backwards; t since the start of the log; g: the nominal logs' own mean loss",
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
            # Springs empty a pilot line faster than its pump fills it: stops are less late than starts.
            Parameter("fall_share", "1", 1.0, 0.15, 2.0),
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
        """By its speeds; a lag of all joints alone may be the measurement channel's.

        Without the nominal logs' own loss, where they have none: with it, logs hardly longer than the time constant do
        not tell the three values apart. By that alone, so that a speed that is other for good is no slow drift.
        """
        cold, warm = (("cold_speed_loss", None),), (("warm_gain", None),)
        return [(cold,), (warm,), (cold, warm)]

    def freed_later(self) -> Variant:
        """How late cold oil is; and what it is known by on other joints."""
        return ((("cold_speed_loss", None),), (("cold_lag", None),))

    def fitted_later(self) -> dict[str, float]:
        """How late stops are beside starts, which the screen cannot tell before it knows of any lag."""
        return {"fall_share": EQUALLY_LATE}

    def freed_beside_nominal(self) -> Variant:
        """The mean loss of the nominal logs, which the frozen model has."""
        return ((("warm_gain", None),),)

    def initial(self, batch: tuple[int, ...]) -> State:
        """At rest: w, (..., n_joint)."""
        return self._zeros(batch)

    def apply(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Late, and slower."""
        ratio, lag_steps = self._at(values, signals)
        lag_steps = self._when(values, lag_steps, u, state)
        # As a change of u, so that neutral values are exactly the identity.
        w = u - lag_steps / (1.0 + lag_steps) * (u - state)
        return w, ratio * w

    def invert(self, values: Values, state: State, v: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """A lag's inverse is a lead."""
        ratio, lag_steps = self._at(values, signals)
        w = v / jnp.maximum(ratio, SMALLEST_RATIO)
        return w, w + self._when(values, lag_steps, w, state) * (w - state)

    def _at(self, values: Values, signals: Signals) -> tuple[jax.Array, jax.Array]:
        """Ratio of speeds and lag at starts, in steps, at the time since start."""
        decay = jnp.exp(-signals.time_s[..., None] / values["time_constant"])
        ratio = 1.0 + values["warm_gain"] - values["cold_speed_loss"] * decay
        return ratio, values["cold_lag"] / self.setting.dt_s * decay

    @staticmethod
    def _when(values: Values, lag_steps: jax.Array, to: jax.Array, since: jax.Array) -> jax.Array:
        """The lag on the way from one speed to another."""
        return lag_steps * jnp.where((to - since) * since < 0.0, values["fall_share"], 1.0)
