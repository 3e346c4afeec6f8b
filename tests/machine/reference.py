"""Forward kinematics of bobcat_e10 from the contract's text: products of 4x4 transforms, float64 NumPy."""

import numpy as np

BOOM_PIVOT_OUT_M, BOOM_PIVOT_UP_M = 0.25, 0.50
BOOM_M, ARM_M, HAMMER_M = 1.35, 0.80, 0.65


def _translation(x: float, y: float, z: float) -> np.ndarray:
    transform = np.eye(4)
    transform[:3, 3] = x, y, z
    return transform


def _turn_about_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def _lift(angle: float) -> np.ndarray:
    """Carries x (outwards) towards z (up)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, -s, 0], [0, 1, 0, 0], [s, 0, c, 0], [0, 0, 0, 1]])


def chisel_transform(q: np.ndarray) -> np.ndarray:
    """Transform (4, 4) of a frame at the chisel tip whose x axis is the chisel's direction."""
    swing, boom, arm, bucket = q
    return (
        _turn_about_z(swing)
        @ _translation(BOOM_PIVOT_OUT_M, 0, BOOM_PIVOT_UP_M)
        @ _lift(boom)
        @ _translation(BOOM_M, 0, 0)
        @ _lift(arm)
        @ _translation(ARM_M, 0, 0)
        @ _lift(bucket)
        @ _translation(HAMMER_M, 0, 0)
    )


def rotation_matrix(quaternion: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) of a unit quaternion (w, u), from its action on vectors: v + 2 u x (u x v + w v)."""
    w, u = quaternion[0], quaternion[1:]
    columns = [v + 2.0 * np.cross(u, np.cross(u, v) + w * v) for v in np.eye(3)]
    return np.stack(columns, axis=1)
