"""Section `policy_repair` of a profile."""

from dataclasses import dataclass, replace

from pipeline.control.apg.config import APGConfig
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.model.specification import ModelSpecification
from pipeline.errors import InputError


@dataclass
class RepairConfig:
    """How a policy is trained further, and what it must be to replace the former one.

    Attributes:
        training_steps: as of `APGConfig`; the last policy is kept.
        learning_rate: of Adam, after the warm-up.
        final_learning_rate: at the end.
        targets: over which the former policy and the new one are compared on the model.
        margin: of a rate: by so much the new policy may at most be worse.
    """

    training_steps: int
    learning_rate: float
    final_learning_rate: float
    targets: int
    margin: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0:
                raise InputError(f"policy_repair.{name} is {value}; it must be positive")
        if not self.margin < 1.0:
            raise InputError(
                f"policy_repair.margin is {self.margin}; it must be below 1, which is all targets"
            )

    def apg(self, apg: APGConfig, model: ModelSpecification) -> APGConfig:
        """Section `apg` for the training of a policy that exists; see `APGConfig.between` for the last setting."""
        return replace(
            apg,
            training_steps=self.training_steps,
            learning_rate=self.learning_rate,
            final_learning_rate=self.final_learning_rate,
            curve_points=1,
            between=apg.between or model.parameterization is Parameterization.nfir,
        )
