"""The loss against its definition."""

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.training.loss import open_loop_loss
from tests.dynamics import reference
from tests.dynamics.conftest import random_trajectory

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
