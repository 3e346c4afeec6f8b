"""The parameterizations of f_θ as pure functions: multilayer perceptron and Kolmogorov-Arnold network.

Both are the same chain: a fixed expansion of each input, then a matrix and a bias. For the MLP the expansion
is the identity before the first layer and SiLU before the others; for the KAN it is the Legendre basis of
tanh(x) before every layer. So the first layer is a sum over its inputs, and the gradient of every matrix is
one product of what went in and what came back: `rollout.py` uses both.
"""

import enum
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp

Parameters = dict[str, dict[str, Any]]


class Parameterization(enum.StrEnum):
    """Which function approximator represents f_θ."""

    mlp = "mlp"
    kan = "kan"
    nfir = "nfir"  # nonlinear finite impulse response: `fir`


class Layer(NamedTuple):
    """What expanded inputs are multiplied by, and what is added.

    Attributes:
        kernel: (n_in * expansion, n_out), input-major.
        bias: (n_out,).
    """

    kernel: jax.Array
    bias: jax.Array


class Network(Protocol):
    """A chain of expansions and layers. Any leading batch axes."""

    @property
    def expansion(self) -> int:
        """Number of expanded values per input of the first layer."""

    def initialise(self, key: jax.Array) -> Parameters:
        """Draw parameters; `key` is consumed."""

    def layers(self, parameters: Parameters) -> list[Layer]:
        """The parameters as matrices."""

    def expand(self, x: jax.Array) -> jax.Array:
        """Expand inputs (..., m) of the first layer to (..., m * expansion), input-major."""

    def activate(self, y: jax.Array) -> jax.Array:
        """Expand the output (..., m) of a layer to what the next layer's kernel multiplies."""


def apply(network: Network, parameters: Parameters, x: jax.Array) -> jax.Array:
    """Evaluate the network: (..., n_in) -> (..., n_out)."""
    first, *others = network.layers(parameters)
    y = network.expand(x) @ first.kernel + first.bias
    for layer in others:
        y = network.activate(y) @ layer.kernel + layer.bias
    return y


class MultilayerPerceptron:
    """Hidden layers with SiLU, linear output (paper, appendix "Training details for dynamic models")."""

    expansion = 1

    def __init__(self, n_in: int, hidden: Sequence[int], n_out: int) -> None:
        self._widths = (n_in, *hidden, n_out)

    def initialise(self, key: jax.Array) -> Parameters:
        """Flax's defaults: LeCun normal kernels, zero biases."""
        from pipeline.dynamics.model import initial_parameters  # slow to import, for training alone

        return initial_parameters.perceptron(key, self._widths)

    def layers(self, parameters: Parameters) -> list[Layer]:
        """Kernels as Flax holds them."""
        return [Layer(layer["kernel"], layer["bias"]) for layer in _in_order(parameters)]

    def expand(self, x: jax.Array) -> jax.Array:
        """The inputs themselves."""
        return x

    def activate(self, y: jax.Array) -> jax.Array:
        """SiLU."""
        return jax.nn.silu(y)


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
        from pipeline.dynamics.model import initial_parameters  # slow to import, for training alone

        return initial_parameters.legendre(key, self._widths, self._degree)

    def layers(self, parameters: Parameters) -> list[Layer]:
        """Coefficients (n_out, n_in, D) of jaxKAN as matrices (n_in * D, n_out)."""
        return [
            Layer(layer["c_basis"].reshape(len(layer["bias"]), -1).T, layer["bias"])
            for layer in _in_order(parameters)
        ]

    def expand(self, x: jax.Array) -> jax.Array:
        """P_1 … P_D of tanh(x), by Bonnet's recursion (n+1) P_{n+1} = (2n+1) x P_n - n P_{n-1}."""
        z = jnp.tanh(x)
        basis = [jnp.ones_like(z), z]
        for n in range(1, self._degree):
            basis.append(((2 * n + 1) * z * basis[n] - n * basis[n - 1]) / (n + 1))
        return jnp.stack(basis[1:], axis=-1).reshape(*x.shape[:-1], -1)

    def activate(self, y: jax.Array) -> jax.Array:
        """As `expand`: all layers are alike."""
        return self.expand(y)


def _in_order(parameters: Parameters) -> list[dict[str, Any]]:
    return [parameters[f"layer_{index}"] for index in range(len(parameters))]
