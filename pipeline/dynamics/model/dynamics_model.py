"""The learned dynamics model (paper, section "Learning a model for the hydraulic arm actuators").

Δq (Eq. general_model_form): q_{t+1} = q_t + f_θ(x̃_t).
Δq̇ (Eqs. vel_prediction, pos_prediction): new velocity = newest velocity in the window + f'_θ(x̃_t);
q_{t+1} = q_t + Δt · new velocity.

The model is pure: it clips nothing, as the paper's equations do not. Whoever needs joint limits (an
environment) clips outside and says so.
"""

import enum
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from pipeline.dynamics.model.features import History, approximate_state, min_max, push
from pipeline.dynamics.model.network import (
    KolmogorovArnoldNetwork,
    MultilayerPerceptron,
    Network,
    Parameterization,
    Parameters,
    apply,
)
from pipeline.errors import InputError


class Target(enum.StrEnum):
    """What the network predicts: position residuals Δq or velocity residuals Δq̇."""

    dq = "dq"
    dqdot = "dqdot"


@dataclass
class ModelSpecification:
    """All that a model is besides its parameters. Lists follow the joint order.

    Attributes:
        parameterization: mlp or kan.
        target: dq or dqdot.
        hidden: Units per hidden layer.
        lags: k; the window holds k+1 rows.
        legendre_degree: Degree of the KAN's basis; not used by the MLP.
        joints: Joint names.
        rate_hz: Rate of the rows.
        position_lower: Joint limits for the normalisation, rad or m.
        position_upper: Joint limits for the normalisation, rad or m.
        velocity_limit: Normalisation of velocities is by ± this, rad/s or m/s. Taken from the training split
            (`specify.velocity_limits`), stored here, never recomputed on other logs.
        residual_scale: The network's outputs are multiplied by this: root mean square of the residual in the
            training split. Only a choice of units: the represented functions are the paper's.
    """

    parameterization: Parameterization
    target: Target
    hidden: list[int]
    lags: int
    legendre_degree: int
    joints: list[str]
    rate_hz: float
    position_lower: list[float]
    position_upper: list[float]
    velocity_limit: list[float]
    residual_scale: list[float]

    def __post_init__(self) -> None:
        self.parameterization = Parameterization(self.parameterization)
        self.target = Target(self.target)
        if not self.hidden or min(self.hidden) < 1:
            raise InputError(
                f"model: hidden is {self.hidden}; list at least one layer, each of at least one unit"
            )
        if self.lags < 0:
            raise InputError(f"model: lags is {self.lags}; it must not be negative")
        if self.legendre_degree < 1:
            raise InputError(f"model: legendre_degree is {self.legendre_degree}; it must be at least 1")
        if not self.rate_hz > 0:
            raise InputError(f"model: rate_hz is {self.rate_hz}; it must be positive")
        for name in ("position_lower", "position_upper", "velocity_limit", "residual_scale"):
            if len(getattr(self, name)) != len(self.joints):
                raise InputError(
                    f"model: {name} has {len(getattr(self, name))} values for {len(self.joints)} joints"
                )
        for name in ("velocity_limit", "residual_scale"):
            if not min(getattr(self, name)) > 0:
                raise InputError(f"model: {name} is {getattr(self, name)}; all values must be positive")

    @property
    def kind(self) -> str:
        """`<parameterization>_<target>`, by which profiles and tables know the model."""
        return f"{self.parameterization}_{self.target}"

    @property
    def n_joint(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def n_features(self) -> int:
        """Dimension of x̃: 2n(k+1) + n."""
        return 2 * self.n_joint * (self.lags + 1) + self.n_joint

    @property
    def dt_s(self) -> float:
        """Length of one time step."""
        return 1.0 / self.rate_hz


class DynamicsModel:
    """Pure functions of (parameters, history, command); all take any leading batch axes."""

    def __init__(self, specification: ModelSpecification) -> None:
        self.specification = specification
        self.network: Network = _network(specification)

    def initialise(self, key: jax.Array) -> Parameters:
        """Draw the parameters θ; `key` is consumed."""
        return self.network.initialise(key)

    def initial_history(self, q: jax.Array) -> History:
        """History of a machine that has been at rest in `q` (..., n_joint): no motion, no commands."""
        rows = (*q.shape[:-1], self.specification.lags + 1, q.shape[-1])
        motion = jnp.zeros(rows, q.dtype)
        if self.specification.target is Target.dq:
            motion = jnp.broadcast_to(q[..., None, :], rows)
        return History(motion=motion, commands=jnp.zeros(rows, q.dtype), q=q)

    def history_from_rows(self, q: jax.Array, qd: jax.Array, a: jax.Array) -> History:
        """History at step t from logged rows that end with row t.

        Args:
            q: (..., rows, n_joint) positions; rows >= k+2, the last is row t.
            qd: (..., rows, n_joint) velocity estimates; that of row t is the newest.
            a: (..., rows, n_joint) commands; that of row t is about to act and not part of the history.
        """
        n_rows = self.specification.lags + 1
        if q.shape[-2] < n_rows + 1:
            raise ValueError(
                f"history_from_rows: got {q.shape[-2]} rows, expected at least lags + 2 = {n_rows + 1}"
            )
        motion = q if self.specification.target is Target.dq else qd
        return History(motion=motion[..., -n_rows:, :], commands=a[..., -n_rows - 1 : -1, :], q=q[..., -1, :])

    def features(self, history: History) -> jax.Array:
        """The policy's x̃_t, (..., 2n(k+1) + n): commands up to a_{t-1}."""
        return approximate_state(
            self.normalise_motion(history.motion), history.commands, self.normalise_position(history.q)
        )

    def step(self, parameters: Parameters, history: History, command: jax.Array) -> History:
        """Advance by one time step under `command` a_t (..., n_joint).

        Returns:
            The history at t+1: q_{t+1} in `q`, the new velocity (or position) appended to `motion`, a_t to
            `commands`.
        """
        history = history._replace(commands=push(history.commands, command))
        residual = self.scale_residual(apply(self.network, parameters, self.features(history)))
        q, newest = self.integrate(history.q, history.motion[..., -1, :], residual)
        return History(motion=push(history.motion, newest), commands=history.commands, q=q)

    def stopped(
        self, parameters: Parameters, history: History, lower: ArrayLike, upper: ArrayLike
    ) -> History:
        """End stops after a step, as `at_stops`; `parameters` are of no use here, only to models with effects."""
        q, newest = self.at_stops(history.q, history.motion[..., -1, :], lower, upper)
        return history._replace(q=q, motion=history.motion.at[..., -1, :].set(newest))

    def at_stops(
        self, q: jax.Array, newest: jax.Array, lower: ArrayLike, upper: ArrayLike
    ) -> tuple[jax.Array, jax.Array]:
        """End stops: a joint beyond a limit (n_joint,), rad or m, is at it, with zero velocity.

        Args:
            q: (..., n_joint).
            newest: its row of `motion`, (..., n_joint).
            lower: limits.
            upper: limits.
        """
        inside = jnp.clip(q, lower, upper)
        at_rest = inside if self.specification.target is Target.dq else jnp.zeros_like(newest)
        return inside, jnp.where(inside == q, newest, at_rest)

    def between_stops(
        self, q: jax.Array, newest: jax.Array, lower: ArrayLike, upper: ArrayLike
    ) -> tuple[jax.Array, jax.Array]:
        """As `at_stops`, for predictions: the position alone ends there, the velocity is what the network says.

        A velocity that is zero from one step to the next is in no log, whose velocities are tracked: the network takes
        it for a sharp deceleration, and bounces.
        """
        inside = jnp.clip(q, lower, upper)
        return inside, inside if self.specification.target is Target.dq else newest

    def stops_beyond(self, lowest: jax.Array, highest: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Lower and upper stops (..., n_joint): the limits, or the furthest that a joint has been beyond them."""
        lower, upper = self.specification.position_lower, self.specification.position_upper
        dtype = lowest.dtype
        return jnp.minimum(jnp.asarray(lower, dtype), lowest), jnp.maximum(jnp.asarray(upper, dtype), highest)

    def integrate(self, q: jax.Array, newest: jax.Array, residual: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Next configuration and next row of `motion` from the newest row and the residual."""
        if self.specification.target is Target.dq:
            q = q + residual
            return q, q
        velocity = newest + residual
        return q + self.specification.dt_s * velocity, velocity

    def scale_residual(self, output: jax.Array) -> jax.Array:
        """Network output (..., n_joint) in units of position (dq) or velocity (dqdot)."""
        return output * jnp.asarray(np.asarray(self.specification.residual_scale), output.dtype)

    def normalise_position(self, q: jax.Array) -> jax.Array:
        """Min-max by the joint limits."""
        return min_max(
            q, np.asarray(self.specification.position_lower), np.asarray(self.specification.position_upper)
        )

    def normalise_motion(self, motion: jax.Array) -> jax.Array:
        """Min-max of the window's rows: by velocity limits (dqdot) or joint limits (dq)."""
        if self.specification.target is Target.dq:
            return self.normalise_position(motion)
        limit = np.asarray(self.specification.velocity_limit)
        return min_max(motion, -limit, limit)


def _network(specification: ModelSpecification) -> Network:
    n_in, n_out = specification.n_features, specification.n_joint
    if specification.parameterization is Parameterization.mlp:
        return MultilayerPerceptron(n_in, specification.hidden, n_out)
    return KolmogorovArnoldNetwork(n_in, specification.hidden, n_out, specification.legendre_degree)
