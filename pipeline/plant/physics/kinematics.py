"""Forward kinematics of the scripted operator, independent of the robot description.

Closed form of the contract's geometry (section 1), frame {B}.
"""

import numpy as np

from pipeline.plant.compiled import compiled

BOOM_PIVOT_RADIUS_M = 0.25
BOOM_PIVOT_HEIGHT_M = 0.50
LINK_LENGTH_M = np.array([1.35, 0.80, 0.65])  # boom, arm, hammer to the chisel's tip


@compiled
def place(q: np.ndarray) -> tuple[float, float, float]:
    """Radius of the tip, m, yaw, rad, and height, m, of joint angles (4,): `tip` for one, compiled."""
    radius, height, angle = 0.0, 0.0, 0.0
    for i in range(3):
        angle += q[1 + i]
        radius += LINK_LENGTH_M[i] * np.cos(angle)
        height += LINK_LENGTH_M[i] * np.sin(angle)
    return BOOM_PIVOT_RADIUS_M + radius, q[0], BOOM_PIVOT_HEIGHT_M + height


def tip(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tip as radius from the swing axis and height, and pitch.

    Args:
        q: joint angles swing, boom, arm, bucket, (…, 4), rad. The yaw is the swing angle.

    Returns:
        Radius and height, (…, 2), m; pitch, (…,), rad, zero with the chisel straight down.
    """
    link_angle = np.cumsum(q[..., 1:], axis=-1)
    radius = BOOM_PIVOT_RADIUS_M + np.sum(LINK_LENGTH_M * np.cos(link_angle), axis=-1)
    height = BOOM_PIVOT_HEIGHT_M + np.sum(LINK_LENGTH_M * np.sin(link_angle), axis=-1)
    return np.stack([radius, height], axis=-1), link_angle[..., -1] + 0.5 * np.pi


def configuration(radius_height: np.ndarray, pitch: float, yaw: float) -> np.ndarray | None:
    """Joint angles (4,), rad, that bring the tip there, elbow up; None where the arm cannot reach."""
    hammer_angle = pitch - 0.5 * np.pi
    x = radius_height[0] - BOOM_PIVOT_RADIUS_M - LINK_LENGTH_M[2] * np.cos(hammer_angle)
    z = radius_height[1] - BOOM_PIVOT_HEIGHT_M - LINK_LENGTH_M[2] * np.sin(hammer_angle)
    boom, arm = LINK_LENGTH_M[:2]
    cosine = (x * x + z * z - boom**2 - arm**2) / (2.0 * boom * arm)
    if abs(cosine) > 1.0:
        return None
    arm_angle = -np.arccos(cosine)
    boom_angle = np.arctan2(z, x) - np.arctan2(arm * np.sin(arm_angle), boom + arm * np.cos(arm_angle))
    return np.array([yaw, boom_angle, arm_angle, hammer_angle - boom_angle - arm_angle])
