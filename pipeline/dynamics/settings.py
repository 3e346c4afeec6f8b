"""Section `identify` of a profile: training of dynamics models, as in the paper's tables."""

import enum
from dataclasses import dataclass

from pipeline.errors import InputError


class Optimiser(enum.StrEnum):
    """Gradient method; the paper does not name one."""

    adam = "adam"


@dataclass
class EnsembleConfig:
    """Ensemble of which a kind `nfir` learns the mean.

    Attributes:
        members: Networks; the training rows are cut into as many parts, and each network leaves one out.
        hidden: Units per hidden layer of each.
        weight_decay: Of AdamW.
    """

    members: int
    hidden: list[int]
    weight_decay: float

    def __post_init__(self) -> None:
        if self.members < 2:
            raise InputError(f"identify: ensemble.members is {self.members}; it must be at least 2")
        if not self.weight_decay >= 0:
            raise InputError(
                f"identify: ensemble.weight_decay is {self.weight_decay}; it must not be negative"
            )


@dataclass
class TrainingConfig:
    """One training run (paper, tables "Selected parameterizations" and "Search spaces").

    Attributes:
        hidden: Units per hidden layer.
        lags: k.
        horizon: H of the training loss.
        learning_rate: Learning rate of the optimiser.
        batch_size: Windows per update.
        maximum_epochs: Largest number of epochs, unless early stopping ends the training.
        ensemble: Of a kind `nfir`; the paper's kinds have none.
    """

    hidden: list[int]
    lags: int
    horizon: int
    learning_rate: float
    batch_size: int
    maximum_epochs: int
    ensemble: EnsembleConfig | None = None

    def __post_init__(self) -> None:
        if isinstance(self.hidden, str):
            return  # OmegaConf builds the node first and the object later
        if not self.hidden or min(self.hidden) < 1:
            raise InputError(
                f"identify: hidden is {self.hidden}; list at least one layer, each of at least one unit"
            )
        if self.lags < 0:
            raise InputError(f"identify: lags is {self.lags}; it must not be negative")
        if not self.learning_rate > 0:
            raise InputError(f"identify: learning_rate is {self.learning_rate}; it must be positive")
        for name in ("horizon", "batch_size", "maximum_epochs"):
            if getattr(self, name) < 1:
                raise InputError(f"identify: {name} is {getattr(self, name)}; it must be at least 1")


@dataclass
class IdentifyConfig:
    """Common settings of all training runs.

    Attributes:
        seed: Seed of the evaluation windows.
        evaluation_horizon: H of L|eval.
        evaluation_windows: Number of fixed evaluation windows.
        patience_evaluations: Early stopping: consecutive evaluations (one per epoch) without improvement.
        optimiser: Gradient method; of an ensemble with decoupled weight decay (AdamW).
        gradient_clip: Largest global norm of the gradient, of each network in an ensemble; null: no clipping.
        cosine_decay: Whether the learning rate falls to zero as a half cosine over the epochs; of an ensemble, always.
        batches_per_epoch: Batches drawn per epoch; null: every window once.
        checkpoint_every_epochs: Epochs between saves of the training state for resuming.
        legendre_degree: Degree of the KAN's basis.
        velocity_limit_quantile: Quantile of |q̇| in the training rows that sets the velocity limits.
        long_prediction_steps: Length of the open-loop prediction that is plotted.
        arx_ridge: Penalty of the reference ARX on standardised inputs, per row.
        selected: The search's selection per `<parameterization>_<target>`.
    """

    seed: int
    evaluation_horizon: int
    evaluation_windows: int
    patience_evaluations: int
    optimiser: Optimiser
    gradient_clip: float | None
    cosine_decay: bool
    batches_per_epoch: int | None
    checkpoint_every_epochs: int
    legendre_degree: int
    velocity_limit_quantile: float
    long_prediction_steps: int
    arx_ridge: float
    selected: dict[str, TrainingConfig]

    def __post_init__(self) -> None:
        for name in (
            "evaluation_horizon",
            "evaluation_windows",
            "patience_evaluations",
            "batches_per_epoch",
            "checkpoint_every_epochs",
            "legendre_degree",
            "long_prediction_steps",
        ):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise InputError(f"identify.{name} is {value}; it must be at least 1")
        if self.gradient_clip is not None and not self.gradient_clip > 0:
            raise InputError(f"identify.gradient_clip is {self.gradient_clip}; it must be positive, or null")
        if not self.arx_ridge >= 0:
            raise InputError(f"identify.arx_ridge is {self.arx_ridge}; it must not be negative")
        if not 0 < self.velocity_limit_quantile <= 1:
            raise InputError(
                f"identify.velocity_limit_quantile is {self.velocity_limit_quantile}; it must be in (0, 1]"
            )

    def training_of(self, kind: str) -> TrainingConfig:
        """What the search selected for a model kind, `<parameterization>_<target>`.

        Raises:
            InputError: Nothing was selected for it.
        """
        if kind not in self.selected:
            raise InputError(f"identify.selected has no {kind}; it has {', '.join(self.selected)}")
        return self.selected[kind]
