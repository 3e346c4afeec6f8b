"""The GPJax side of gaussian_process.py, with NumPy and GPJax only, so that it runs in an environment of its own.

Per joint, speed to the next row over the window of commands and the position: a linear and a squared exponential kernel
with a length scale per input. Hyper-parameters have the largest marginal likelihood on random rows. Predictions use all
rows through inducing points (Titsias, AISTATS 2009). Reads questions as lines of JSON: first a fit, then predictions.
"""

import json
import sys
import time
from functools import partial
from pathlib import Path

import gpjax
import jax
import jax.numpy as jnp
import numpy as np
import optax
import paramax

jax.config.update("jax_enable_x64", True)

MARGINAL_ROWS, ITERATIONS, LEARNING_RATE = 600, 80, 0.1
INDUCING = 1000
CHUNK = 128  # windows at once
JITTER = 1e-6


def fitted_kernel(x, y):
    """Kernel and noise variance with the largest marginal likelihood on (x, y), (N, d) and (N, 1)."""
    n_input = x.shape[1]
    kernel = gpjax.kernels.SumKernel(
        kernels=[
            gpjax.kernels.Linear(n_dims=n_input, variance=0.1),
            gpjax.kernels.RBF(
                n_dims=n_input, lengthscale=jnp.full(n_input, np.sqrt(n_input) / 2.0), variance=0.5
            ),
        ]
    )
    prior = gpjax.gps.Prior(mean_function=gpjax.mean_functions.Zero(), kernel=kernel)
    posterior = prior * gpjax.likelihoods.Gaussian(obs_stddev=jnp.array(0.1))
    best, _ = gpjax.fit(
        model=posterior,
        objective=lambda model, data: -gpjax.objectives.conjugate_mll(model, data),
        train_data=gpjax.Dataset(X=x, y=y),
        optim=optax.adam(LEARNING_RATE),
        num_iters=ITERATIONS,
        verbose=False,
    )
    return best


class JointProcess:
    """One joint's speed."""

    def __init__(self, x, speed, order):
        self.scale = float(np.sqrt(np.mean(speed**2)))
        y = jnp.asarray(speed / self.scale)[:, None]
        some = order[:MARGINAL_ROWS]
        best = fitted_kernel(x[some], y[some])
        linear, squared = best.prior.kernel.kernels
        self.linear = jnp.asarray(_value(linear.variance))
        self.variance, self.length = (jnp.asarray(_value(v)) for v in (squared.variance, squared.lengthscale))
        noise = float(np.asarray(_value(best.likelihood.obs_stddev)).squeeze()) ** 2
        self.z = x[order[-INDUCING:]]
        k_zx = self.gram(self.z, x)
        k_zz = self.gram(self.z, self.z) + JITTER * jnp.eye(len(self.z))
        self.weights = jnp.linalg.solve(noise * k_zz + k_zx @ k_zx.T, k_zx @ y)[:, 0]

    def gram(self, a, b):
        """Covariances of inputs (N, d) and (M, d), of the speed over its root mean square; (N, M)."""
        u, v = a / self.length, b / self.length
        distance = jnp.sum(u**2, 1)[:, None] + jnp.sum(v**2, 1)[None] - 2.0 * u @ v.T
        return self.linear * a @ b.T + self.variance * jnp.exp(-0.5 * distance)

    def speed(self, x):
        """Expected speed for inputs (N, d), rad/s or m/s; (N,)."""
        return self.scale * self.gram(x, self.z) @ self.weights


def _value(parameter):
    """Of a parameter of GPJax, which wraps its unconstrained number."""
    return paramax.unwrap(parameter)


def fit(question):
    begin = time.process_time()
    with np.load(question["file"]) as data:
        commands, place, speed = (data[name] for name in ("commands", "place", "speed"))
    x = jnp.asarray(np.concatenate([commands.reshape(len(commands), -1), place], axis=1))
    order = np.random.default_rng(question["seed"]).permutation(len(x))
    joints = [JointProcess(x, speed[:, joint], order) for joint in range(speed.shape[1])]
    return joints, commands.shape[1], {"processor_s": time.process_time() - begin}


def roll_out(joints, n_lag, commands, q, lower, upper, scale, dt_s):
    """Positions (B, H, n) after each of H steps from q (B, n), with commands (B, n_lag - 1 + H, n)."""

    def advance(q, step):
        window = jax.lax.dynamic_slice_in_dim(commands, step, n_lag, axis=1)
        place = 2.0 * (q - scale[0]) / (scale[1] - scale[0]) - 1.0
        x = jnp.concatenate([window.reshape(len(window), -1), place], axis=1)
        q = jnp.clip(q + dt_s * jnp.stack([joint.speed(x) for joint in joints], axis=1), lower, upper)
        return q, q

    _, path = jax.lax.scan(advance, q, jnp.arange(commands.shape[1] - n_lag + 1))
    return jnp.moveaxis(path, 0, 1)


def main():
    joints, n_lag, answer = fit(json.loads(sys.stdin.readline()))
    print(json.dumps(answer), flush=True)
    predict = jax.jit(partial(roll_out, joints, n_lag))
    for line in sys.stdin:
        question = json.loads(line)
        with np.load(question["file"]) as data:
            arrays = {name: data[name] for name in data.files}
        n = len(arrays["q"])
        scale = arrays.pop("scale")
        parts = []
        for first in range(0, n, CHUNK):  # the last chunk reaches back, so that all have one shape
            part = slice(max(min(first, n - CHUNK), 0), first + CHUNK)
            path = predict(**{k: v[part] for k, v in arrays.items()}, scale=scale, dt_s=question["dt_s"])
            parts.append(np.asarray(path)[first - part.start :])
        file = Path(question["file"]).with_name("answer.npy")
        np.save(file, np.concatenate(parts))
        print(json.dumps({"file": str(file)}), flush=True)


if __name__ == "__main__":
    main()
