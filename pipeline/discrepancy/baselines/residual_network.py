"""Baseline: a black-box residual network on top of the frozen model.

The delta-dynamics of ASAP (He et al., 2025, "ASAP: Aligning Simulation and Real-World Physics for Learning Agile
Humanoid Whole-Body Skills"): the identified model stays as it is, and a second network g_φ learns from
measured logs what it lacks. Here both see x̃_t, and their outputs add up to the predicted residual:

    Δq (or Δq̇) = f_θ(x̃_t) + g_φ(x̃_t),    θ frozen, g_φ = 0 before training.

Two networks of one depth that see the same input are one network with block-diagonal kernels, so rollout,
loss and training are those of the model. g_φ has the model's own parameterization and hidden layers.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import jax.scipy.linalg

from pipeline.discrepancy.baselines.continued_training import BaselinesConfig, continue_training
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.kinds import build_model
from pipeline.dynamics.model.network import Layer, Network, Parameters
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification


class NetworkWithResidual:
    """f_θ + g_φ as a `Network` whose parameters are φ."""

    def __init__(self, frozen: Network, frozen_parameters: Parameters) -> None:
        """f_θ is `frozen` with θ `frozen_parameters`; g_φ is of the same kind and size."""
        self._frozen_layers = frozen.layers(frozen_parameters)
        self._residual = frozen
        self.expansion = frozen.expansion
        self.expand = frozen.expand
        self.activate = frozen.activate

    def initialise(self, key: jax.Array) -> Parameters:
        """Draw φ with an output layer of zeros: g_φ is exactly zero, whatever its input; `key` is consumed."""
        parameters = self._residual.initialise(key)
        last = f"layer_{len(parameters) - 1}"
        return parameters | {last: jax.tree.map(jnp.zeros_like, parameters[last])}

    def layers(self, parameters: Parameters) -> list[Layer]:
        """Hidden layers side by side, which do not see each other; output layers summed."""
        first, *hidden, last = zip(self._frozen_layers, self._residual.layers(parameters), strict=True)
        biases = [jnp.concatenate([pair[0].bias, pair[1].bias]) for pair in (first, *hidden)]
        kernels = [jnp.concatenate([first[0].kernel, first[1].kernel], axis=1)]
        kernels += [jax.scipy.linalg.block_diag(pair[0].kernel, pair[1].kernel) for pair in hidden]
        return [
            *(Layer(*pair) for pair in zip(kernels, biases, strict=True)),
            Layer(jnp.concatenate([last[0].kernel, last[1].kernel]), last[0].bias + last[1].bias),
        ]


def model_with_residual(model: DynamicsModel, parameters: Parameters) -> DynamicsModel:
    """The model with a residual network on top.

    Args:
        parameters: θ, frozen within the result.

    Returns:
        A model whose parameters are φ alone; `initialise` gives a φ at which it predicts as `model` does.
    """
    corrected = build_model(model.specification)
    corrected.network = NetworkWithResidual(model.network, parameters)
    return corrected


def fit_residual_network(
    model: DynamicsModel,
    parameters: Parameters,
    trajectories: Sequence[Trajectory],
    machine: MachineSpecification,
    settings: BaselinesConfig,
    seed: int,
) -> LearnedPredictor:
    """Train a residual network on measured rows; arguments and errors as of `continue_training`.

    Returns:
        The predictor f_θ + g_φ; f_θ itself where no training made the selection rows better.
    """
    corrected = model_with_residual(model, parameters)
    initial = corrected.initialise(jax.random.key(seed))
    trained = continue_training(corrected, initial, trajectories, machine, settings, seed)
    if trained is initial:
        return LearnedPredictor(model, parameters)  # also without the rounding of wider matrix products
    return LearnedPredictor(corrected, trained)
