"""Parameters of the networks as drawn by the libraries whose layers they are: Flax and jaxKAN.

Apart from `network.py`, as only a training draws them: whoever loads a model is spared a second of imports.
"""

from collections.abc import Sequence
from typing import Any

import jax
from flax import nnx
from jaxkan.layers.Legendre import LegendreLayer


def perceptron(key: jax.Array, widths: Sequence[int]) -> dict[str, dict[str, Any]]:
    """Flax's defaults: LeCun normal kernels, zero biases. `key` is consumed."""
    return _parameters(
        [nnx.Linear(n_in, n_out, rngs=nnx.Rngs(key)) for n_in, n_out, key in _layers(key, widths)]
    )


def legendre(key: jax.Array, widths: Sequence[int], degree: int) -> dict[str, dict[str, Any]]:
    """The default of jaxKAN: truncated normal coefficients, zero biases. `key` is consumed."""
    return _parameters(
        [LegendreLayer(n_in, n_out, degree, seed=key) for n_in, n_out, key in _layers(key, widths)]
    )


def _layers(key: jax.Array, widths: Sequence[int]) -> list[tuple[int, int, jax.Array]]:
    """Inputs, outputs and key of each layer."""
    return list(zip(widths[:-1], widths[1:], jax.random.split(key, len(widths) - 1), strict=True))


def _parameters(layers: Sequence[nnx.Module]) -> dict[str, dict[str, Any]]:
    return {
        f"layer_{index}": nnx.to_pure_dict(nnx.state(layer, nnx.Param)) for index, layer in enumerate(layers)
    }
