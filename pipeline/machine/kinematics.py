"""Forward kinematics of the arm, from its URDF (paper, "Computational pipeline").

The paper computes it with Brax. Here the chain is written out, component by component. That is ten times cheaper in the
loops of policies and planners, and needs no import that takes seconds. `tests/machine/test_kinematics.py` holds it
against Brax, MuJoCo and a product of transforms.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from pipeline.errors import InputError
from pipeline.machine.chain import (
    FIXED,
    GROUND,
    ChainJoint,
    Surfaces,
    arm_description,
    read_chain,
    read_surfaces,
    urdf_path,
)
from pipeline.machine.components import Components, about, add, multiply, rotate, scale
from pipeline.machine.specification import JointKind, MachineSpecification

if TYPE_CHECKING:
    import jax

Array = TypeVar("Array", "jax.Array", np.ndarray)
ORIENTATION_TOLERANCE = 1e-9  # on 1 - |r1 . r2| of unit quaternions: some 1e-4 rad


class Pose(NamedTuple):
    """Pose of the chisel tip in the base frame {B} (z up, x forward).

    Attributes:
        position: m, shape (..., 3).
        quaternion: unit quaternion (w, x, y, z), shape (..., 4); see `pipeline.machine.orientation`.
    """

    position: Any
    quaternion: Any


class Arm:
    """Kinematics of one arm: configurations in the machine's joint order in, poses out.

    Every method is a pure function of its argument, of NumPy or JAX, over any leading axes and in the precision of its
    argument; with JAX it works under `jit`, `vmap` and `grad`. Arms are built by `load_arm`.

    Attributes:
        joints: From the base to the chisel tip, fixed ones included.
        columns: The place of each in a configuration; None of a fixed one.
        surfaces: What the tip meets.
    """

    def __init__(
        self, machine: MachineSpecification, joints: Sequence[ChainJoint], surfaces: Surfaces = GROUND
    ) -> None:
        arm, names = arm_description(machine), machine.joint_names
        self.joints = tuple(joints)
        self.n_joint, self.surfaces = machine.n_joint, surfaces
        self.columns = [None if joint.kind == FIXED else names.index(joint.name) for joint in joints]
        self._yaw_index = names.index(arm.yaw_joint)
        self._pitch_indices = np.array([names.index(name) for name in arm.pitch_joints])
        self._pitch_offset_rad = arm.pitch_offset_rad

    def components(self, q: Array) -> tuple[Components, Components]:
        """Position, m, and unit quaternion of the chisel tip in {B}, for `q` as of `forward`.

        Returns:
            Components, each of shape (...) or a number.
        """
        functions = q.__array_namespace__()
        position: Components = (0.0, 0.0, 0.0)
        rotation: Components = (1.0, 0.0, 0.0, 0.0)
        for joint, column in zip(self.joints, self.columns, strict=True):
            position = add(position, rotate(rotation, joint.position))
            rotation = multiply(rotation, joint.quaternion)
            if column is None:
                continue
            if joint.kind == JointKind.prismatic:
                position = add(position, rotate(rotation, scale(q[..., column], joint.axis)))
            else:
                rotation = multiply(rotation, about(joint.axis, q[..., column], functions))
        return position, rotation

    def forward(self, q: Array) -> Pose:
        """Pose of the chisel tip.

        Args:
            q: configuration, rad (m for prismatic joints), shape (..., n_joint).

        Returns:
            The pose in {B}. The quaternion is continuous in `q` and equals
            `quaternion_from_yaw_pitch(yaw(q), pitch(q))`.
        """
        functions = q.__array_namespace__()

        def stacked(components: Components) -> Any:
            rows = [functions.broadcast_to(functions.asarray(one), q.shape[:-1]) for one in components]
            return functions.stack([row.astype(q.dtype) for row in rows], axis=-1)

        return Pose(*map(stacked, self.components(q)))

    def yaw(self, q: Array) -> Array:
        """Yaw of the chisel, rad, shape (...); positive to the left."""
        return q[..., self._yaw_index]

    def pitch(self, q: Array) -> Array:
        """Pitch of the chisel, rad, shape (...); zero straight down, positive with the tip outwards."""
        return q[..., self._pitch_indices].sum(axis=-1) + self._pitch_offset_rad


def load_arm(machine: MachineSpecification, directory: Path) -> Arm:
    """Build the arm's kinematics from its robot description.

    Args:
        machine: the machine; its `arm` section names the URDF and the frame of the chisel tip.
        directory: where conf/machine lies.

    Raises:
        InputError: the machine has no arm section; its URDF is missing or contradicts it
            (`pipeline.machine.chain.read_chain`); or yaw and pitch of the machine are not those of the end
            effector's frame.
    """
    path = urdf_path(machine, directory)
    arm = Arm(machine, read_chain(machine, directory), read_surfaces(path))
    _check_orientation(machine, path, arm)
    return arm


def _check_orientation(machine: MachineSpecification, path: Path, arm: Arm) -> None:
    """Compare the end effector's frame with the specification's yaw and pitch at both ends of the travel."""
    q = np.array([machine.lower, machine.upper])
    expected = multiply(about((0, 0, 1), arm.yaw(q), np), about((0, -1, 0), arm.pitch(q), np))
    same = np.abs(sum(a * b for a, b in zip(arm.components(q)[1], expected, strict=True)))
    if (same < 1.0 - ORIENTATION_TOLERANCE).any():
        name = arm_description(machine).end_effector
        raise InputError(
            f"{path}: the frame {name} is not turned by yaw about z and then by minus the pitch about y, as section "
            f"arm of conf/machine/{machine.name}.yaml has them; correct its rpy or the joints' axes"
        )
