"""The loss against its definition, its gradient against finite differences."""

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.loss import open_loop_loss

from . import reference
from .conftest import random_trajectory

H, STARTS = 5, (6, 9, 11)
SCALE = np.array([1.0, 0.25])


def arguments(model, log):
    history = model.history_from_rows(
        *(jnp.stack([rows[t - 5 : t + 1] for t in STARTS]) for rows in (log.q, log.qd, log.a))
    )
    commands = jnp.stack([log.a[t : t + H] for t in STARTS])
    q = jnp.stack([log.q[t + 1 : t + H + 1] for t in STARTS])
    return history, commands, q, jnp.asarray(SCALE)


def test_loss_is_the_papers(model, parameters):
    log = random_trajectory(4, n_rows=20)
    losses = []
    for t in STARTS:
        predicted = reference.rollout(model.specification, parameters, log.q, log.qd, log.a, t, H)
        losses.append(
            sum(np.linalg.norm((predicted[j] - log.q[t + 1 + j]) / SCALE) ** 2 for j in range(H)) / H
        )
    with jax.enable_x64(True):
        loss = jax.jit(lambda p: open_loop_loss(model, p, *arguments(model, log)))(parameters)
    np.testing.assert_allclose(loss, np.mean(losses), rtol=1e-12)


def test_gradient_is_that_of_finite_differences(model, parameters):
    log = random_trajectory(4, n_rows=20)
    random = np.random.default_rng(0)
    direction = jax.tree.map(lambda leaf: random.normal(size=leaf.shape), parameters)
    step = 1e-5
    with jax.enable_x64(True):
        loss = jax.jit(lambda parameters: open_loop_loss(model, parameters, *arguments(model, log)))
        gradient = jax.jit(jax.grad(loss))(parameters)
        slope = sum(
            jax.tree.leaves(jax.tree.map(lambda g, d: np.sum(np.asarray(g) * d), gradient, direction))
        )
        ahead = jax.tree.map(lambda p, d: p + step * d, parameters, direction)
        behind = jax.tree.map(lambda p, d: p - step * d, parameters, direction)
        difference = (float(loss(ahead)) - float(loss(behind))) / (2 * step)
    np.testing.assert_allclose(slope, difference, rtol=1e-6)
