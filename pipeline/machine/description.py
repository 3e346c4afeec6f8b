"""The robot description (URDF) as MuJoCo's model."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from pipeline.errors import InputError
from pipeline.machine.chain import arm_description, read_chain, urdf_path
from pipeline.machine.specification import MachineSpecification


@dataclass(frozen=True, eq=False)
class RobotDescription:
    """A URDF that agrees with its machine.

    Attributes:
        path: the file, for messages.
        model: MuJoCo's model of the moving links only (fixed links are fused into them), without shapes.
        joint_order: position in the machine's joint order of each joint of `model`, shape (n_joint,).
        end_effector_link: index among `model`'s moving links (the world is not one) of the link that carries
            the end effector.
        end_effector_position: of the end effector's frame in that link, m, shape (3,), float64.
        end_effector_quaternion: its orientation in that link (w, x, y, z), shape (4,), float64.
    """

    path: Path
    model: mujoco.MjModel
    joint_order: np.ndarray
    end_effector_link: int
    end_effector_position: np.ndarray
    end_effector_quaternion: np.ndarray


def read_urdf(path: Path) -> mujoco.MjSpec:
    """The URDF as MuJoCo's editable specification.

    Raises:
        InputError: the file is not a URDF that MuJoCo can read.
    """
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise InputError(f"{path}: not a readable URDF: {error}") from error


def _compile(path: Path, fuse: bool) -> mujoco.MjModel:
    specification = read_urdf(path)
    specification.compiler.fusestatic = fuse
    for geom in specification.geoms:
        specification.delete(geom)
    try:
        return specification.compile()
    except ValueError as error:
        raise InputError(f"{path}: not a valid robot description: {error}") from error


def load_description(machine: MachineSpecification, directory: Path) -> RobotDescription:
    """Reads the machine's URDF and checks that it describes this machine.

    Args:
        directory: where conf/machine lies.

    Raises:
        InputError: the URDF does not describe this machine (`pipeline.machine.chain.read_chain`), or MuJoCo
            cannot compile it.
    """
    read_chain(machine, directory)
    path = urdf_path(machine, directory)
    model, unfused = _compile(path, fuse=True), _compile(path, fuse=False)
    tip = mujoco.mj_name2id(unfused, mujoco.mjtObj.mjOBJ_BODY, arm_description(machine).end_effector)
    carrier = unfused.body_weldid[tip]  # the moving body to which the tip is fixed
    data = mujoco.MjData(unfused)
    mujoco.mj_kinematics(unfused, data)
    position, quaternion = _relative(data, carrier, tip)
    joint_order = np.array([machine.joint_names.index(model.joint(i).name) for i in range(model.njnt)])
    link = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, unfused.body(carrier).name) - 1
    return RobotDescription(path, model, joint_order, link, position, quaternion)


def _relative(data: mujoco.MjData, parent: int, child: int) -> tuple[np.ndarray, np.ndarray]:
    """Position and quaternion of body `child` in the frame of body `parent`."""
    inverse_position, inverse_quaternion = np.zeros(3), np.zeros(4)
    mujoco.mju_negPose(inverse_position, inverse_quaternion, data.xpos[parent], data.xquat[parent])
    position, quaternion = np.zeros(3), np.zeros(4)
    mujoco.mju_mulPose(
        position, quaternion, inverse_position, inverse_quaternion, data.xpos[child], data.xquat[child]
    )
    return position, quaternion
