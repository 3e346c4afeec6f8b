"""Coloured noise: Gaussian sequences with power spectrum f^-β.

Spectrum as in J. Timmer and M. Koenig: On generating power law noise. Astronomy and Astrophysics 300 (1995), and in the
package `colorednoise` that the published iCEM uses: amplitude f^(-β/2) at the frequencies of a sequence of H
entries, and at frequency zero that of the lowest one. Independent Fourier components times fixed amplitudes, then
transformed back, are a fixed matrix times independent normal numbers; here it is that matrix, which is as exact and
for some tens of entries cheaper than a transform.

One difference: `colorednoise` leaves the zero frequency out where it scales to unit variance, so that its variance
is above one (1.32 for H = 20, β = 2). Here every entry has variance one exactly.
"""

import jax
import jax.numpy as jnp
import numpy as np


def synthesis_matrix(n_entries: int, exponent: float) -> np.ndarray:
    """The matrix M with M z coloured noise of unit variance for independent standard normal z.

    Columns: for every frequency k = 0 … H/2 a cosine and a sine over the entries, with the frequency's amplitude.
    Sines of frequency zero and, where H is even, of the highest one are zero and left out, so M is square.

    Args:
        n_entries: H, length of a sequence.
        exponent: β.

    Returns:
        Shape (H, H), float64; every row has norm one.
    """
    wave = np.fft.rfftfreq(n_entries)
    lowest = 1.0 / n_entries
    amplitude = np.maximum(wave, lowest) ** (-exponent / 2.0)
    angle = 2.0 * np.pi * np.outer(np.arange(n_entries), wave)
    is_real = (np.arange(len(wave)) == 0) | (wave == 0.5)
    # A complex component counts twice, at ±f, with a real and an imaginary part of equal variance; a real one counts
    # once, with twice the variance (its magnitude is that of the others).
    cosines = np.where(is_real, np.sqrt(2.0), 2.0) * amplitude * np.cos(angle)
    sines = (-2.0 * amplitude * np.sin(angle))[:, ~is_real]
    matrix = np.concatenate([cosines, sines], axis=1)
    return matrix / np.linalg.norm(matrix, axis=1, keepdims=True)


def coloured_noise(key: jax.Array, synthesis: jax.Array, n: int, n_joint: int) -> jax.Array:
    """Sequences coloured along time and independent across joints; `key` is consumed.

    Args:
        key: of the random numbers.
        synthesis: of `synthesis_matrix`, shape (H, H).
        n: number of sequences.
        n_joint: dimension of an action.

    Returns:
        Shape (n, H, n_joint).
    """
    white = jax.random.normal(key, (n, synthesis.shape[0], n_joint), synthesis.dtype)
    return jnp.einsum("ht,ntj->nhj", synthesis, white)
