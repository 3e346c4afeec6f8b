"""Forward kinematics of the arm with Brax, from the robot description (paper, "Computational pipeline").

Brax is imported once an arm is loaded: it takes seconds, and many modules import this one for its types alone.
"""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from pipeline.machine.chain import arm_description
from pipeline.machine.description import RobotDescription, load_description
from pipeline.machine.specification import MachineSpecification

if TYPE_CHECKING:
    from brax import base

Array = TypeVar("Array", jax.Array, np.ndarray)


class Pose(NamedTuple):
    """Pose of the chisel tip in the base frame {B} (z up, x forward).

    Attributes:
        position: m, shape (..., 3).
        quaternion: unit quaternion (w, x, y, z), shape (..., 4); see `pipeline.machine.orientation`.
    """

    position: jax.Array
    quaternion: jax.Array


class Arm:
    """Kinematics of one arm: configurations in the machine's joint order in, poses out.

    Every method is a pure function of its argument, works under `jit`, `vmap` and `grad`, over any leading
    axes and in the precision of its argument. Arms are built by `load_arm`.
    """

    def __init__(
        self, machine: MachineSpecification, description: RobotDescription, system: "base.System"
    ) -> None:
        arm = arm_description(machine)
        self.description = description
        self.n_joint = machine.n_joint
        self._joint_order = description.joint_order
        self._link = description.end_effector_link
        self._tip_position = description.end_effector_position
        self._tip_quaternion = description.end_effector_quaternion
        self._system = system
        self._yaw_index = machine.joint_names.index(arm.yaw_joint)
        self._pitch_indices = np.array([machine.joint_names.index(name) for name in arm.pitch_joints])
        self._pitch_offset_rad = arm.pitch_offset_rad

    def forward(self, q: jax.Array) -> Pose:
        """Pose of the chisel tip.

        Args:
            q: configuration, rad (m for prismatic joints), shape (..., n_joint).

        Returns:
            The pose in {B}. The quaternion is continuous in `q` and equals
            `quaternion_from_yaw_pitch(yaw(q), pitch(q))`.
        """
        from brax import base, kinematics

        q = jnp.asarray(q)
        chain = (self._system.link, self._system.dof)
        link, dof = jax.tree.map(lambda leaf: jnp.asarray(leaf, q.dtype), chain)
        system = self._system.replace(link=link, dof=dof)
        tip = base.Transform(
            pos=jnp.asarray(self._tip_position, q.dtype), rot=jnp.asarray(self._tip_quaternion, q.dtype)
        )

        def single(configuration: jax.Array) -> Pose:
            # zero velocities in, velocities out ignored: the compiler removes their computation
            links, _ = kinematics.forward(system, configuration, jnp.zeros_like(configuration))
            end_effector = links.take(self._link).do(tip)
            return Pose(end_effector.pos, end_effector.rot)

        # A copy: JAX remembers a NumPy array it has seen at the precision of that time, and callers may use another.
        flat = q[..., self._joint_order.copy()].reshape(-1, self.n_joint)
        position, quaternion = jax.vmap(single)(flat)
        return Pose(position.reshape(*q.shape[:-1], 3), quaternion.reshape(*q.shape[:-1], 4))

    def yaw(self, q: Array) -> Array:
        """Yaw of the chisel, rad, shape (...); positive to the left."""
        return q[..., self._yaw_index]

    def pitch(self, q: Array) -> Array:
        """Pitch of the chisel, rad, shape (...); zero straight down, positive with the tip outwards."""
        return q[..., self._pitch_indices].sum(axis=-1) + self._pitch_offset_rad


def load_arm(machine: MachineSpecification, directory: Path) -> Arm:
    """Builds the arm's kinematics from its robot description.

    Args:
        machine: the machine; its `arm` section names the URDF and the frame of the chisel tip.
        directory: where conf/machine lies.

    Raises:
        InputError: the machine has no arm section, or its URDF is missing or contradicts it
            (`pipeline.machine.description.load_description`).
    """
    import pipeline.machine.quiet_mjx  # noqa: F401 # isort: skip (before Brax)
    from brax.io import mjcf

    description = load_description(machine, Path(directory))
    with warnings.catch_warnings():
        # Brax warns that its physics is unmaintained; only its kinematics and its PPO are used here.
        warnings.filterwarnings("ignore", message="Brax System", category=UserWarning)
        system = mjcf.load_model(description.model)
    return Arm(machine, description, _in_float64(system, description))


def _in_float64(system: "base.System", description: RobotDescription) -> "base.System":
    """The system with the chain's geometry as float64 NumPy arrays, which Brax had rounded to JAX's
    precision.

    A URDF gives every moving link one joint, so the links' and the joints' rows agree.
    """
    from brax import base

    model = description.model
    identity = np.tile([1.0, 0.0, 0.0, 0.0], (model.njnt, 1))
    link = system.link.replace(
        transform=base.Transform(pos=model.body_pos[1:].copy(), rot=model.body_quat[1:].copy()),
        joint=base.Transform(pos=model.jnt_pos.copy(), rot=identity),
    )
    rotates = (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)[:, None]
    motion = base.Motion(
        ang=np.where(rotates, model.jnt_axis, 0.0), vel=np.where(rotates, 0.0, model.jnt_axis)
    )
    return system.replace(link=link, dof=system.dof.replace(motion=motion))
