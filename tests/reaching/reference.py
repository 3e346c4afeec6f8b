"""The reward of the paper in float64 NumPy, written from its equations and tables, one state at a time."""

import math

import numpy as np


def reward(state: dict[str, np.ndarray | float | bool]) -> dict[str, float]:
    """Terms of r_t; constants are those of the table "Modeling and algorithms hyperparameters"."""
    p, p_target = np.asarray(state["p"], float), np.asarray(state["p_target"], float)
    r, r_target = np.asarray(state["r"], float), np.asarray(state["r_target"], float)
    q, q_target = np.asarray(state["q"], float), np.asarray(state["q_target"], float)
    a, a_previous = np.asarray(state["a"], float), np.asarray(state["a_previous"], float)

    d = math.sqrt(sum((p_target - p) ** 2))
    d_g = 1 / math.pi * math.acos(min(1.0, max(-1.0, 2 * float(r_target @ r) ** 2 - 1)))
    pose = -1.0 * d - 1.0 * d_g
    configuration = -1.0 * math.sqrt(sum((q - q_target) ** 2))

    b_pose = (1 if d < 0.1 else 0) * (1 if d_g < 0.1 else 0)
    b_pose_fine = (1 if d < 0.05 else 0) * (1 if d_g < 0.02 else 0)
    b_angle = 1
    for name in ("yaw", "pitch"):
        b_angle *= 1 if (state[name] - state[f"{name}_target"]) ** 2 < 0.0001 else 0
    b_q = 1
    for j in range(4):
        b_q *= 1 if (q[j] - q_target[j]) ** 2 < 0.0025 else 0
    precision = 0.5 * (b_pose + b_pose_fine) + 1.0 * b_angle + 1.0 * b_q

    action = -0.5 * 1 / 4 * sum(abs(a[i] - a_previous[i]) for i in range(4))
    workspace = -2.0 * (0 if state["inside"] else 1)
    return {
        "pose": pose,
        "configuration": configuration,
        "precision": precision,
        "action": action,
        "workspace": workspace,
    }


def orientation(yaw: float, pitch: float) -> np.ndarray:
    """Unit quaternion (w, x, y, z) of a turn by yaw about z, then by -pitch about the turned y axis."""
    w, z = math.cos(yaw / 2), math.sin(yaw / 2)
    c, s = math.cos(-pitch / 2), math.sin(-pitch / 2)
    return np.array([w * c, -z * s, w * s, z * c])


def near_a_threshold(state: dict[str, np.ndarray | float | bool], margin: float = 1e-5) -> bool:
    """Whether float32 may decide a bonus differently than float64."""
    d = float(np.linalg.norm(np.asarray(state["p_target"]) - np.asarray(state["p"])))
    d_g = math.acos(min(1.0, 2 * float(np.dot(state["r_target"], state["r"])) ** 2 - 1)) / math.pi
    angles = [abs(state[name] - state[f"{name}_target"]) for name in ("yaw", "pitch")]
    joints = np.abs(np.asarray(state["q"]) - np.asarray(state["q_target"]))
    distances = [abs(d - 0.1), abs(d - 0.05), abs(d_g - 0.1), abs(d_g - 0.02)]
    distances += [abs(angle - 0.01) for angle in angles] + [abs(joint - 0.05) for joint in joints]
    return min(distances) < margin
