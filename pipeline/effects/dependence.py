"""`other`: speed that depends on a variable in a way that the named families do not describe.

One class per variable of the contract's list, all with the same wrapper: the ratio is one plus a sum of basis functions
of the variable, with coefficients per joint, direction of motion and source. They compete with the named families, do
not name a cause, and form the unnamed corrections.
"""

from abc import abstractmethod
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.effects.effect import (
    SMALLEST_COMMAND,
    Abscissa,
    Along,
    Card,
    RatioEffect,
    Scope,
    Signals,
    State,
    Values,
    Variant,
    direction_weights,
)

N_DIRECTION = 2


class Dependence(RatioEffect):
    """v_j = u_j (1 + Σ_{s,k} c_{j,d,s,k} φ_k(x_s)), d the direction of u_j."""

    variable: ClassVar[str]
    n_basis: ClassVar[int]
    per_source: ClassVar[bool] = False  # whether the variables are other joints', or channels
    common: ClassVar[bool] = False  # whether the variable belongs to the machine
    reference: ClassVar[int | None] = None  # reference basis function, where the ratio is one without a gain

    def neutral(self) -> dict[str, np.ndarray]:
        """All coefficients zero: (n_joint, 2, n_source, n_basis)."""
        shape = (self.setting.n_joint, N_DIRECTION, self.n_source, self.n_basis)
        return {"coefficients": np.zeros(shape)}

    @property
    def n_source(self) -> int:
        """How many variables it may be a dependence on."""
        return self.setting.n_joint if self.per_source else 1

    def grid(self) -> list[dict[str, float]]:
        """Empty: the model is linear in all parameters."""
        return [{}]

    def variants(self) -> list[Variant]:
        """Empty: the search builds variants by source and direction."""
        return []

    @abstractmethod
    def basis(self, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """(..., n_source or n_joint, n_basis)."""

    def ratio(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """One plus the dependence."""
        state, basis = self.basis(state, u, signals)
        return state, 1.0 + jnp.clip(self.change(values, basis, u), -0.95, 3.0)

    def change(self, values: Values, basis: jax.Array, u: jax.Array) -> jax.Array:
        """Sum of the basis functions in the direction of motion, (..., n_joint)."""
        equation = "...jdsk,...sk->...jd" if self.per_source else "...jdsk,...jk->...jd"
        by_direction = jnp.einsum(equation, values["coefficients"], basis)
        positive, negative = direction_weights(u)
        return by_direction[..., 0] * negative + by_direction[..., 1] * positive


def _card(
    variable: str,
    equation: str,
    signature: str,
    drawn_over: Abscissa,
    scope: Scope = Scope.joint,
    form: str | None = None,
    complexity: float = 5.0,
) -> Card:
    return Card(
        family=f"other:{form or variable}",
        equation=equation,
        source="one additive term per variable: Hastie and Tibshirani (1990), Generalized Additive Models",
        signature=signature,
        confounded_with=(),
        excitation="variation of the variable while everything else is repeated",
        depends_on=(variable,),
        scope=scope,
        complexity=complexity,
        drawn_over=drawn_over,
        counted_along=Along.motion,
        can_set_in=False,
        parameters=(),
    )


class OnCommand(Dependence):
    """Dependence on another joint's command direction while this joint is commanded.

    After its command ends, a joint runs out at its last speed: later commands of other joints do not act through a
    closed valve.
    """

    variable, n_basis, per_source = "command", 2, True
    card = _card(
        "command",
        "φ = 1[a_s < 0], 1[a_s > 0], s ≠ j, while a_j ≠ 0, and after it as at its end",
        "residual only while another joint is commanded one way",
        Abscissa.command,
    )

    def initial(self, batch: tuple[int, ...]) -> State:
        """The relative change at the joint's last driven step."""
        return self._zeros(batch)

    def basis(self, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Indicators, softened for proportional commands."""
        return state, jnp.stack(
            [jnp.maximum(-signals.command, 0.0), jnp.maximum(signals.command, 0.0)], axis=-1
        )

    def ratio(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """One plus the dependence, which is held while the joint runs out."""
        _, basis = self.basis(state, u, signals)
        is_driven = jnp.abs(signals.command) >= SMALLEST_COMMAND
        state = jnp.where(is_driven, self.change(values, basis, u), state)
        return state, 1.0 + jnp.clip(state, -0.95, 3.0)


class OnPosition(Dependence):
    """Piecewise linear dependence on a joint's position."""

    variable, n_basis, per_source, reference = "position", 7, True, 6
    card = _card(
        "position",
        "φ: hat functions at ±1, ±2/3, ±1/3 and 0 of half the range; the middle is the reference",
        "residual follows one joint's position",
        Abscissa.position,
    )
    spacing = 1.0 / 3.0
    knots = (-1.0, -2 * spacing, -spacing, spacing, 2 * spacing, 1.0, 0.0)  # the hat functions sum to one

    def basis(self, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Hat functions with the width of the knot spacing."""
        middle = 0.5 * (self.setting.upper + self.setting.lower)
        place = (signals.q - middle) / (0.5 * (self.setting.upper - self.setting.lower))
        place = jnp.clip(place, -1.0, 1.0)
        return state, jnp.maximum(
            0.0, 1.0 - jnp.abs(place[..., None] - jnp.asarray(self.knots)) / self.spacing
        )


class OnHoldTime(Dependence):
    """Dependence on the hold time of the present command."""

    variable, n_basis = "hold_time", 3
    card = _card(
        "hold_time",
        "φ_k = 1 − e^{−h/T_k}, h the time since the command's last change",
        "residual grows while a command is held",
        Abscissa.since_command,
    )
    times_s = (0.7, 2.0, 5.0)

    def initial(self, batch: tuple[int, ...]) -> State:
        """Hold time and the command held."""
        return self._zeros(batch), self._zeros(batch)

    def basis(self, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Rising exponentials."""
        held_s, held = state
        same = jnp.sign(signals.command) == jnp.sign(held)
        held_s = jnp.where(same, held_s + self.setting.dt_s, 0.0)
        return (held_s, signals.command), _rising(held_s, self.times_s)


class OnWarmth(Dependence):
    """Dependence on the recent hold time per direction, as of a coil that warms up under a command."""

    variable, n_basis = "hold_time", 2
    card = _card(
        "hold_time",
        "ẇ_k = (1[a = d] − w_k) / T_k, φ_k = w_k, d the direction of motion",
        "residual grows while a command is held, and is still there when it is given again soon",
        Abscissa.since_command,
        form="warmth",
    )
    times_s = (1.5, 6.0)

    def initial(self, batch: tuple[int, ...]) -> State:
        """Cold in both directions."""
        return jnp.zeros((*batch, self.setting.n_joint, N_DIRECTION, len(self.times_s)))

    def basis(self, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Leaky means of the command's presence."""
        present = jnp.stack([jnp.maximum(-signals.command, 0.0), jnp.maximum(signals.command, 0.0)], axis=-1)
        share = 1.0 - np.exp(-self.setting.dt_s / np.asarray(self.times_s))
        state = state + share * (present[..., None] - state)
        return state, jnp.where((u > 0.0)[..., None], state[..., 1, :], state[..., 0, :])


class OnRestTime(Dependence):
    """Dependence on the joint's rest before the present motion."""

    variable, n_basis = "rest_time", 2
    card = _card(
        "rest_time",
        "φ_k = 1 − e^{−r/T_k}, r the rest before the present motion",
        "residual of a whole motion depends on the rest before it",
        Abscissa.since_command,
    )
    times_s = (0.8, 4.0)

    def initial(self, batch: tuple[int, ...]) -> State:
        """Rest so far, and whether the joint is commanded."""
        return self._zeros(batch), self._zeros(batch)

    def basis(self, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Rising exponentials of the rest."""
        rest_s, moving = state
        is_zero = jnp.abs(signals.command) < SMALLEST_COMMAND
        rest_s = jnp.where(is_zero, jnp.where(moving > 0.0, 0.0, rest_s) + self.setting.dt_s, rest_s)
        return (rest_s, jnp.where(is_zero, 0.0, 1.0)), _rising(rest_s, self.times_s)


class OnReversal(Dependence):
    """Dependence on the time since the last sign change of the joint's command."""

    variable, n_basis = "reversal", 2
    card = _card(
        "reversal",
        "φ_k = e^{−x/T_k}, x the time since the last reversal",
        "residual after reversals only",
        Abscissa.since_command,
    )
    times_s = (0.4, 1.5)

    def initial(self, batch: tuple[int, ...]) -> State:
        """Time since the reversal and the last sign."""
        return self._zeros(batch) + 60.0, self._zeros(batch)

    def basis(self, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Falling exponentials."""
        since_s, sign = state
        now = jnp.where(jnp.abs(signals.command) < SMALLEST_COMMAND, sign, jnp.sign(signals.command))
        since_s = jnp.where(now * sign < 0.0, 0.0, since_s + self.setting.dt_s)
        return (since_s, now), 1.0 - _rising(since_s, self.times_s)


class OnVelocity(Dependence):
    """Dependence on the speed itself."""

    variable, n_basis = "velocity", 2
    passes = 8
    card = _card(
        "velocity",
        "φ = s, s², s the speed in units of the usual one, less one",
        "residual not proportional to speed",
        Abscissa.velocity,
    )

    def basis(self, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Powers of the speed."""
        share = jnp.minimum(jnp.abs(u) / self.setting.speed_scale, 2.0) - 1.0
        return state, jnp.stack([share, share**2], axis=-1)


class OnActivity(Dependence):
    """Dependence on the recent motion of all joints."""

    variable, n_basis, common = "activity", 4, True
    passes = 3
    card = _card(
        "activity",
        "Ȧ_k = (Σ_i |u_i| / scale_i − A_k) / T_k, φ_k = A_k",
        "all joints slow down after busy spells",
        Abscissa.velocity,
        Scope.machine,
        complexity=5.2,  # for a single joint, its own variables are a simpler explanation
    )
    times_s = (4.0, 10.0, 25.0, 60.0)

    def initial(self, batch: tuple[int, ...]) -> State:
        """Zero activity."""
        return jnp.zeros((*batch, len(self.times_s)))

    def basis(self, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Leaky means of activity."""
        activity = jnp.mean(jnp.abs(u) / self.setting.speed_scale, axis=-1, keepdims=True)
        share = 1.0 - np.exp(-self.setting.dt_s / np.asarray(self.times_s))
        state = state + share * (activity - state)
        return state, jnp.broadcast_to(state[..., None, :], (*u.shape, len(self.times_s)))


class OnTravel(Dependence):
    """Dependence on the joint's travel since the start of the log."""

    variable, n_basis = "travel", 1
    passes = 3
    card = _card(
        "travel",
        "φ = 1 − e^{−s/S}, s the joint's way since the start, S ten times its range",
        "residual grows with the joint's own way, not with time",
        Abscissa.time,
    )
    ranges = 10.0

    def initial(self, batch: tuple[int, ...]) -> State:
        """Zero travel."""
        return self._zeros(batch)

    def basis(self, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Saturating and therefore bounded."""
        state = state + jnp.abs(u) * self.setting.dt_s
        span = self.ranges * (self.setting.upper - self.setting.lower)
        return state, (1.0 - jnp.exp(-state / span))[..., None]


class OnChannel(Dependence):
    """Piecewise linear dependence on a measured channel, such as a pressure or a temperature.

    Each basis function rises over its part of the channel's range, so that a coefficient is the change of the ratio
    from one end of the part to the other. At the channel's usual value the ratio is one.
    """

    variable, n_basis, per_source, common = "channel", 4, True, True
    card = _card(
        "channel",
        "φ_k(x) − φ_k(usual x), φ_k rising from 0 to 1 over the k-th quarter of the channel's range",
        "residual proportional to speed that follows a measured channel",
        Abscissa.channel,
        Scope.machine,
        complexity=5.2,  # as of the machine's activity
    )

    @property
    def n_source(self) -> int:
        """The machine's channels."""
        return len(self.setting.channels)

    def basis(self, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """(..., n_channel, n_basis); zero where the channel is not known."""
        lower, upper, usual = (
            np.array([getattr(of, name) for of in self.setting.channels], np.float32)
            for name in ("lower", "upper", "usual")
        )
        width = np.where(upper > lower, upper - lower, np.inf)

        def rise(x: jax.Array) -> jax.Array:
            return jnp.clip(
                self.n_basis * ((x - lower) / width)[..., None] - np.arange(self.n_basis), 0.0, 1.0
            )

        unknown = jnp.full((*u.shape[:-1], self.n_source), jnp.nan)
        x = unknown if signals.channels is None else signals.channels
        return state, rise(jnp.where(jnp.isnan(x), usual, x)) - rise(jnp.asarray(usual))


def _rising(time_s: jax.Array, constants_s: tuple[float, ...]) -> jax.Array:
    return 1.0 - jnp.exp(-time_s[..., None] / jnp.asarray(constants_s))


DEPENDENCES: dict[str, type[Dependence]] = {
    dependence.card.family: dependence
    for dependence in (
        OnCommand,
        OnPosition,
        OnHoldTime,
        OnWarmth,
        OnRestTime,
        OnReversal,
        OnVelocity,
        OnActivity,
        OnTravel,
        OnChannel,
    )
}
