"""The two parameterizations of f_θ as pure functions: multilayer perceptron and Kolmogorov-Arnold network.

Both are the same chain: a fixed expansion of each input, then a matrix. For the MLP the expansion is the
identity before the first layer and SiLU before the others; for the KAN it is the Legendre basis of tanh(x)
before every layer. So the first layer is a sum over its inputs, which `rollout.py` uses: what does not
change within a rollout enters once.
"""

import enum
from collections.abc import Sequence
from typing import Any, Protocol

import jax
import jax.numpy as jnp
from flax import nnx
from jaxkan.layers.Legendre import LegendreLayer

Parameters = dict[str, dict[str, Any]]


class Parameterization(enum.StrEnum):
    """Which function approximator represents f_θ."""

    mlp = "mlp"
    kan = "kan"


class Network(Protocol):
    """A network whose first layer is a sum of contributions of its inputs. Any leading batch axes."""

    @property
    def expansion(self) -> int:
        """Number of expanded values per input of the first layer."""

    def initialise(self, key: jax.Array) -> Parameters:
        """Draw parameters; `key` is consumed."""

    def expand(self, x: jax.Array) -> jax.Array:
        """Expand inputs (..., m) of the first layer to (..., m * expansion), input-major."""

    def first_kernel(self, parameters: Parameters) -> jax.Array:
        """Matrix (n_in * expansion, width) that expanded inputs are multiplied by."""

    def remaining(self, parameters: Parameters, first: jax.Array) -> jax.Array:
        """Output (..., n_out) from the expanded inputs times `first_kernel`, (..., width)."""


def apply(network: Network, parameters: Parameters, x: jax.Array) -> jax.Array:
    """Evaluate the network: (..., n_in) -> (..., n_out)."""
    return network.remaining(parameters, network.expand(x) @ network.first_kernel(parameters))


class MultilayerPerceptron:
    """Hidden layers with SiLU, linear output (paper, appendix "Training details for dynamic models")."""

    expansion = 1

    def __init__(self, n_in: int, hidden: Sequence[int], n_out: int) -> None:
        self._widths = (n_in, *hidden, n_out)

    def initialise(self, key: jax.Array) -> Parameters:
        """Flax's defaults: LeCun normal kernels, zero biases."""
        keys = jax.random.split(key, len(self._widths) - 1)
        pairs = zip(self._widths[:-1], self._widths[1:], keys, strict=True)
        layers = [nnx.Linear(n_in, n_out, rngs=nnx.Rngs(key)) for n_in, n_out, key in pairs]
        return _parameters(layers)

    def expand(self, x: jax.Array) -> jax.Array:
        """The inputs themselves."""
        return x

    def first_kernel(self, parameters: Parameters) -> jax.Array:
        """Kernel of layer 0."""
        return parameters["layer_0"]["kernel"]

    def remaining(self, parameters: Parameters, first: jax.Array) -> jax.Array:
        """Bias of layer 0, then SiLU and the further layers."""
        y = first + parameters["layer_0"]["bias"]
        for index in range(1, len(self._widths) - 1):
            layer = parameters[f"layer_{index}"]
            y = jax.nn.silu(y) @ layer["kernel"] + layer["bias"]
        return y


class KolmogorovArnoldNetwork:
    """Legendre layers of jaxKAN (Rigas and Papachristou, 2025), each with a key of its own.

    A layer computes y_o = b_o + Σ_i Σ_{d=1..D} c_{oid} P_d(tanh x_i).
    """

    def __init__(self, n_in: int, hidden: Sequence[int], n_out: int, degree: int) -> None:
        self._widths = (n_in, *hidden, n_out)
        self._degree = degree

    @property
    def expansion(self) -> int:
        """Degree of the basis; the constant polynomial is the bias."""
        return self._degree

    def initialise(self, key: jax.Array) -> Parameters:
        """The default of jaxKAN: truncated normal coefficients, zero biases."""
        keys = jax.random.split(key, len(self._widths) - 1)
        pairs = zip(self._widths[:-1], self._widths[1:], keys, strict=True)
        return _parameters([LegendreLayer(n_in, n_out, self._degree, seed=key) for n_in, n_out, key in pairs])

    def expand(self, x: jax.Array) -> jax.Array:
        """P_1 … P_D of tanh(x), by Bonnet's recursion (n+1) P_{n+1} = (2n+1) x P_n - n P_{n-1}."""
        z = jnp.tanh(x)
        basis = [jnp.ones_like(z), z]
        for n in range(1, self._degree):
            basis.append(((2 * n + 1) * z * basis[n] - n * basis[n - 1]) / (n + 1))
        return jnp.stack(basis[1:], axis=-1).reshape(*x.shape[:-1], -1)

    def first_kernel(self, parameters: Parameters) -> jax.Array:
        """Coefficients of layer 0."""
        return _coefficients(parameters["layer_0"])

    def remaining(self, parameters: Parameters, first: jax.Array) -> jax.Array:
        """Bias of layer 0, then the further layers."""
        y = first + parameters["layer_0"]["bias"]
        for index in range(1, len(self._widths) - 1):
            layer = parameters[f"layer_{index}"]
            y = self.expand(y) @ _coefficients(layer) + layer["bias"]
        return y


def _parameters(layers: Sequence[nnx.Module]) -> Parameters:
    return {
        f"layer_{index}": nnx.to_pure_dict(nnx.state(layer, nnx.Param)) for index, layer in enumerate(layers)
    }


def _coefficients(layer: dict[str, Any]) -> jax.Array:
    """(n_out, n_in, D) of jaxKAN as the matrix (n_in * D, n_out)."""
    coefficients = layer["c_basis"]
    return coefficients.reshape(coefficients.shape[0], -1).T
