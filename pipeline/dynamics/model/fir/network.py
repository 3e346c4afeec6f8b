"""The network of a nonlinear finite-impulse-response model: from a window of commands and a position to a velocity."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.network import Layer, MultilayerPerceptron, Parameters


class FirNetwork(MultilayerPerceptron):
    """A perceptron that sees commands, the normalised position, and what joints ask of their supply together.

    Joints that share a supply are slower together from the point on where they ask for more than there is. By how much
    Σ|a| exceeds given numbers goes in, as means over stretches of the window that are short where it is new. Told so,
    the network need not learn it joint by joint: logs hold few rows of any three joints that move at once.

    A mean is linear in the rows that it is over. So the first layer is given as a kernel over whole rows, the excesses
    beside the commands, and whoever rolls out need not know of stretches.
    """

    def __init__(
        self, n_joint: int, lags: int, beyond: Sequence[int], hidden: Sequence[int], n_out: int
    ) -> None:
        """Arguments as of `FirSpecification`; `beyond` are the numbers that Σ|a| may exceed."""
        self._n_joint, self._n_rows, self._beyond = n_joint, lags + 1, np.asarray(beyond, float)
        self._means = _means(self._n_rows)
        n_in = n_joint * (lags + 2) + len(beyond) * len(self._means)
        super().__init__(n_in, hidden, n_out)
        self._n_layers = len(hidden) + 1

    @property
    def row(self) -> int:
        """Values per row of the window."""
        return self._n_joint + len(self._beyond)

    def rows(self, commands: jax.Array) -> jax.Array:
        """Commands (..., n_joint) and their excesses: (..., row)."""
        together = jnp.sum(jnp.abs(commands), axis=-1, keepdims=True)
        return jnp.concatenate([commands, jnp.maximum(together - self._beyond, 0.0)], axis=-1)

    def layers(self, parameters: Parameters) -> list[Layer]:
        """The first layer's kernel is over rows, oldest first and time-major, and then the position."""
        own = {name: parameters[name] for name in (f"layer_{index}" for index in range(self._n_layers))}
        first, *others = super().layers(own)
        of_commands, of_excess, of_position = jnp.split(
            first.kernel, [self._n_joint * self._n_rows, len(first.kernel) - self._n_joint]
        )
        width = first.kernel.shape[-1]
        per_row = of_commands.reshape(self._n_rows, self._n_joint, width)
        if len(self._beyond):
            stretches = of_excess.reshape(len(self._means), len(self._beyond), width)
            spread = jnp.tensordot(jnp.asarray(self._means.T, stretches.dtype), stretches, axes=1)
            per_row = jnp.concatenate([per_row, spread], axis=1)
        kernel = jnp.concatenate([per_row.reshape(-1, width), of_position])
        return [Layer(kernel, first.bias), *others]


def _means(n_rows: int) -> np.ndarray:
    """(n_stretches, n_rows): the mean over each stretch; from the newest row back they are 1, 1, 2, 4, … rows long."""
    ends = [n_rows - 2**k for k in reversed(range(n_rows.bit_length())) if 2**k < n_rows]
    means = np.zeros((len(ends) + 1, n_rows))
    for mean, stretch in zip(means, np.split(np.arange(n_rows), ends), strict=True):
        mean[stretch] = 1.0 / len(stretch)
    return means
