"""The frames of a robot description, joint by joint, for any configuration, as viewers need them."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation


class JointTransforms(NamedTuple):
    """Poses of a joint's child link in its parent link, over time.

    Attributes:
        parent: name of the link.
        child: name of the link.
        position: m, (T, 3); for a fixed joint (1, 3).
        quaternion: (w, x, y, z), (T, 4); for a fixed joint (1, 4).
    """

    parent: str
    child: str
    position: np.ndarray
    quaternion: np.ndarray


def joint_transforms(urdf: Path, configurations: Mapping[str, np.ndarray]) -> list[JointTransforms]:
    """Transforms of all joints of a URDF.

    Args:
        urdf: the robot description.
        configurations: positions by joint, rad (m for prismatic joints), (T,) each; other joints stay at zero.
    """
    found = []
    for joint in ElementTree.parse(urdf).getroot().findall("joint"):
        origin, turn = _numbers(joint, "origin", "xyz"), _numbers(joint, "origin", "rpy")
        axis = _numbers(joint, "axis", "xyz", "1 0 0")
        q = np.asarray(configurations.get(str(joint.get("name")), np.zeros(1)), float)
        base = Rotation.from_euler("xyz", turn)  # URDF: fixed axes, roll first
        is_sliding = joint.get("type") == "prismatic"
        moved = np.outer(q, axis if is_sliding else np.zeros(3))
        turned = base * Rotation.from_rotvec(np.outer(np.zeros(len(q)) if is_sliding else q, axis))
        quaternion = np.roll(turned.as_quat(), 1, axis=-1)  # SciPy has w last
        found.append(
            JointTransforms(
                _link(joint, "parent"), _link(joint, "child"), origin + base.apply(moved), quaternion
            )
        )
    return found


def _numbers(joint: ElementTree.Element, tag: str, attribute: str, default: str = "0 0 0") -> np.ndarray:
    element = joint.find(tag)
    text = default if element is None else element.get(attribute, default)
    return np.array([float(word) for word in text.split()])


def _link(joint: ElementTree.Element, tag: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.get("link", "")
