"""The robot description (URDF), read with MuJoCo and checked against the machine's specification."""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from pipeline.errors import InputError
from pipeline.machine.specification import ArmDescription, JointKind, MachineSpecification

LIMIT_TOLERANCE = 1e-6  # rad or m: limits closer than this agree
ORIENTATION_TOLERANCE = 1e-9  # on 1 - |r1 . r2| of unit quaternions: some 1e-4 rad
_MUJOCO_KINDS = {
    JointKind.revolute: mujoco.mjtJoint.mjJNT_HINGE,
    JointKind.prismatic: mujoco.mjtJoint.mjJNT_SLIDE,
}


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


def arm_description(machine: MachineSpecification) -> ArmDescription:
    """The machine's `arm` section.

    Raises:
        InputError: the specification has no such section.
    """
    if machine.arm is None:
        raise InputError(
            f"conf/machine/{machine.name}.yaml: no section arm; poses need one (urdf, "
            "end_effector, yaw_joint, pitch_joints, pitch_offset_rad)"
        )
    return machine.arm


def urdf_path(machine: MachineSpecification, directory: Path) -> Path:
    """Path of the machine's URDF.

    Args:
        directory: where conf/machine lies.

    Raises:
        InputError: the machine names no URDF, or the file is missing.
    """
    path = Path(directory) / arm_description(machine).urdf
    if not path.is_file():
        raise InputError(
            f"{path}: no such robot description; correct arm.urdf in conf/machine/{machine.name}.yaml"
        )
    return path


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
        InputError: the URDF is missing or unreadable; a joint of the machine is missing in it, has another
            kind or other limits; it has a further moving joint; it lacks the end effector; or yaw and pitch
            of the machine are not those of the end effector's frame.
    """
    arm = arm_description(machine)
    path = urdf_path(machine, directory)
    model = _compile(path, fuse=True)
    _check_joints(machine, path, model)
    unfused = _compile(path, fuse=False)
    tip = mujoco.mj_name2id(unfused, mujoco.mjtObj.mjOBJ_BODY, arm.end_effector)
    if tip < 0:
        raise InputError(
            f"{path}: no link {arm.end_effector}, the arm.end_effector of conf/machine/{machine.name}.yaml"
        )
    carrier = unfused.body_weldid[tip]  # the moving body to which the tip is fixed
    data = mujoco.MjData(unfused)
    mujoco.mj_kinematics(unfused, data)
    position, quaternion = _relative(data, carrier, tip)
    joint_order = np.array([machine.joint_names.index(model.joint(i).name) for i in range(model.njnt)])
    link = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, unfused.body(carrier).name) - 1
    _check_orientation(machine, arm, path, unfused, tip)
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


def _check_joints(machine: MachineSpecification, path: Path, model: mujoco.MjModel) -> None:
    found = [model.joint(i).name for i in range(model.njnt)]
    for joint in machine.joints:
        if joint.name not in found:
            raise InputError(f"{path}: no moving joint {joint.name}; it has {', '.join(found)}")
        described = model.joint(joint.name)
        if described.type[0] != _MUJOCO_KINDS[JointKind(joint.kind)]:
            raise InputError(
                f"{path}: joint {joint.name} is not {joint.kind}, as conf/machine/{machine.name}.yaml says"
            )
        if np.abs(described.range - [joint.lower, joint.upper]).max() > LIMIT_TOLERANCE:
            raise InputError(
                f"{path}: joint {joint.name} has limits [{described.range[0]:g}, {described.range[1]:g}], "
                f"conf/machine/{machine.name}.yaml has [{joint.lower:g}, {joint.upper:g}]; make them agree"
            )
    for name in found:
        if name not in machine.joint_names:
            raise InputError(
                f"{path}: joint {name} moves but is not a joint of machine {machine.name}; "
                "make it fixed or list it"
            )


def _check_orientation(
    machine: MachineSpecification, arm: ArmDescription, path: Path, model: mujoco.MjModel, tip: int
) -> None:
    """Compares the end effector's frame with the specification's yaw and pitch at both ends of the travel."""
    for name in (arm.yaw_joint, *arm.pitch_joints):
        if name not in machine.joint_names:
            raise InputError(
                f"conf/machine/{machine.name}.yaml: arm names joint {name}, which is not among the joints "
                f"{', '.join(machine.joint_names)}"
            )
    data = mujoco.MjData(model)
    for q in (machine.lower, machine.upper):
        position = dict(zip(machine.joint_names, q, strict=True))
        for name, value in position.items():
            data.joint(name).qpos = value
        mujoco.mj_kinematics(model, data)
        yaw = position[arm.yaw_joint]
        pitch = sum(position[name] for name in arm.pitch_joints) + arm.pitch_offset_rad
        turns = np.zeros((3, 4))
        mujoco.mju_axisAngle2Quat(turns[0], np.array([0.0, 0.0, 1.0]), yaw)
        mujoco.mju_axisAngle2Quat(turns[1], np.array([0.0, -1.0, 0.0]), pitch)
        mujoco.mju_mulQuat(turns[2], turns[0], turns[1])
        if abs(turns[2] @ data.xquat[tip]) < 1.0 - ORIENTATION_TOLERANCE:
            raise InputError(
                f"{path}: the frame {arm.end_effector} is not turned by yaw about z and then by minus the "
                f"pitch about y, as section arm of conf/machine/{machine.name}.yaml has them; correct its "
                "rpy or the joints' axes"
            )
