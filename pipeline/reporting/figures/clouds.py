"""End-effector clouds of logged trajectories."""

import numpy as np

from pipeline.machine.kinematics import Arm
from pipeline.reporting.figures.workspace import Cloud

MAXIMUM_POINTS = 10_000  # more cannot be distinguished in a picture


def cloud_of(arm: Arm, q: np.ndarray) -> Cloud:
    """Positions and pitch of the chisel tip in configurations q, shape (n, n_joint), thinned for drawing."""
    stride = max(1, -(-len(q) // MAXIMUM_POINTS))
    return Cloud(arm.forward(q[::stride]).position, arm.pitch(q[::stride]))
