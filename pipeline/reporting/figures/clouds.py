"""End-effector clouds of logged trajectories."""

import jax.numpy as jnp
import numpy as np

from pipeline.machine.kinematics import Arm
from pipeline.reporting.figures.workspace import Cloud

MAXIMUM_POINTS = 10_000  # more cannot be distinguished in a picture


def cloud_of(arm: Arm, q: np.ndarray) -> Cloud:
    """Positions and pitch of the chisel tip in configurations q, shape (n, n_joint), thinned for drawing."""
    stride = max(1, -(-len(q) // MAXIMUM_POINTS))
    thinned = jnp.asarray(q[::stride], jnp.float32)
    return Cloud(np.asarray(arm.forward(thinned).position), np.asarray(arm.pitch(thinned)))
