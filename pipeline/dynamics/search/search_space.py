"""The search space of hyper-parameters (paper, Table "Search spaces for the dynamic models hyperparameters")."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from pipeline.dynamics.settings import EnsembleConfig, TrainingConfig
from pipeline.errors import InputError

Value = TypeVar("Value", int, float)

SEARCHED = ("lags", "learning_rate", "batch_size", "horizon", "layers", "units")


class Choose(Protocol):
    """Chooses one of the options for the hyper-parameter of this name; equal names, equal options."""

    def __call__(self, name: str, options: Sequence[Value]) -> Value:
        """The chosen option."""


@dataclass
class SearchSpace:
    """The options per hyper-parameter, of one parameterization.

    Attributes:
        lags: k.
        learning_rate: Learning rate of the optimiser.
        batch_size: Windows per update.
        horizon: H of the training loss.
        layers: Number of hidden layers.
        units: Units of a hidden layer; chosen for each layer.
        maximum_epochs: The same for all trials.
        ensemble: The same for all trials of a kind `nfir`; the paper's kinds have none.
    """

    lags: list[int]
    learning_rate: list[float]
    batch_size: list[int]
    horizon: list[int]
    layers: list[int]
    units: list[int]
    maximum_epochs: int
    ensemble: EnsembleConfig | None = None

    def __post_init__(self) -> None:
        if isinstance(self.lags, str):
            return  # OmegaConf builds the node first and the object later
        for name in SEARCHED:
            options = getattr(self, name)
            if not options:
                raise InputError(f"search.spaces: {name} is empty; list at least one option")
            if len(set(options)) < len(options):
                raise InputError(f"search.spaces: {name} is {list(options)}; list each option once")
            smallest = 0 if name == "lags" else 1
            if name == "learning_rate" and not min(options) > 0:
                raise InputError(f"search.spaces: {name} is {list(options)}; all options must be positive")
            if name != "learning_rate" and min(options) < smallest:
                raise InputError(
                    f"search.spaces: {name} is {list(options)}; all options must be at least {smallest}"
                )
        if self.maximum_epochs < 1:
            raise InputError(f"search.spaces: maximum_epochs is {self.maximum_epochs}; it must be at least 1")


def propose(space: SearchSpace, choose: Choose) -> TrainingConfig:
    """One point of the space; each layer's units are chosen independently."""
    layers = choose("layers", space.layers)
    return TrainingConfig(
        hidden=[choose(f"units_{layer}", space.units) for layer in range(1, layers + 1)],
        lags=choose("lags", space.lags),
        horizon=choose("horizon", space.horizon),
        learning_rate=choose("learning_rate", space.learning_rate),
        batch_size=choose("batch_size", space.batch_size),
        maximum_epochs=space.maximum_epochs,
        ensemble=space.ensemble,
    )
