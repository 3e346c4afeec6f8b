"""What a dynamics model is besides its parameters."""

import enum
from dataclasses import dataclass

from pipeline.dynamics.model.network import Parameterization
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
