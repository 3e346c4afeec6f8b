"""End-effector clouds of logged trajectories."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from pipeline.logs.tuples import Trajectory
from pipeline.machine.kinematics import Arm
from pipeline.reporting.workspace_figures import Cloud

CLOUD_STRIDE = 10  # rows between two drawn positions: every half second at 20 Hz


def cloud_of(arm: Arm, trajectories: Sequence[Trajectory]) -> Cloud:
    """Positions and pitch of the chisel tip along the trajectories, thinned for drawing."""
    q = jnp.asarray(
        np.concatenate([trajectory.q[::CLOUD_STRIDE] for trajectory in trajectories]), jnp.float32
    )
    return Cloud(np.asarray(arm.forward(q).position), np.asarray(arm.pitch(q)))
