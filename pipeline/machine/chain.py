"""The arm's kinematic chain, read from its URDF and checked against the machine's specification.

NumPy alone: pages on logs need positions of the chisel tip, and neither MuJoCo nor JAX, which take seconds to import.
`pipeline.machine.kinematics.Arm` computes the same (`tests/machine/test_chain.py`), and can be differentiated.
"""

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pipeline.errors import InputError
from pipeline.machine.specification import ArmDescription, JointKind, MachineSpecification

LIMIT_TOLERANCE = 1e-6  # rad or m: limits closer than this agree
ORIENTATION_TOLERANCE = 1e-9  # on 1 - |r1 . r2| of unit quaternions: some 1e-4 rad
FIXED, CONTINUOUS = "fixed", "continuous"


@dataclass(frozen=True, eq=False)
class ChainJoint:
    """A joint of the URDF, which may be fixed.

    Attributes:
        name: In the URDF.
        kind: The URDF's word; a continuous joint is a revolute one.
        parent: Link that carries it.
        child: Link that it carries.
        position: Of the child's frame in the parent's at zero, m, shape (3,).
        rotation: The same frame's orientation, shape (3, 3).
        axis: Unit vector in the child's frame, shape (3,).
        limits: Lower and upper, rad or m; zeros where the URDF has none.
    """

    name: str
    kind: str
    parent: str
    child: str
    position: np.ndarray
    rotation: np.ndarray
    axis: np.ndarray
    limits: tuple[float, float]


class ArmChain:
    """The joints from the base to the chisel tip; built by `read_chain`."""

    def __init__(self, machine: MachineSpecification, joints: list[ChainJoint]) -> None:
        arm = arm_description(machine)
        names = machine.joint_names
        self._joints = [(joint, names.index(joint.name) if joint.kind != FIXED else None) for joint in joints]
        self._yaw_index = names.index(arm.yaw_joint)
        self._pitch_indices = [names.index(name) for name in arm.pitch_joints]
        self._pitch_offset_rad = arm.pitch_offset_rad

    def forward(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position, m, shape (n, 3), and rotation, shape (n, 3, 3), of the chisel tip in the base frame {B}.

        Args:
            q: configurations in the machine's joint order, rad (m for prismatic joints), shape (n, n_joint).
        """
        position, rotation = np.zeros((len(q), 3)), np.tile(np.eye(3), (len(q), 1, 1))
        for joint, index in self._joints:
            position = position + rotation @ joint.position
            rotation = rotation @ joint.rotation
            if index is None:
                continue
            value = np.asarray(q[:, index], np.float64)
            if joint.kind == JointKind.prismatic:
                position = position + rotation @ joint.axis * value[:, None]
            else:
                rotation = rotation @ _turns(joint.axis, value)
        return position, rotation

    def yaw(self, q: np.ndarray) -> np.ndarray:
        """Yaw of the chisel, rad, shape (n,); positive to the left."""
        return q[:, self._yaw_index]

    def pitch(self, q: np.ndarray) -> np.ndarray:
        """Pitch of the chisel, rad, shape (n,); zero straight down, positive with the tip outwards."""
        return q[:, self._pitch_indices].sum(axis=1) + self._pitch_offset_rad


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


def read_chain(machine: MachineSpecification, directory: Path) -> ArmChain:
    """Read the machine's URDF and check that it describes this machine.

    Args:
        machine: the machine; its `arm` section names the URDF and the frame of the chisel tip.
        directory: where conf/machine lies.

    Raises:
        InputError: the URDF is missing or unreadable; a joint of the machine is missing in it, has another
            kind or other limits; it has a further moving joint; it lacks the end effector; or yaw and pitch
            of the machine are not those of the end effector's frame.
    """
    arm = arm_description(machine)
    path = urdf_path(machine, directory)
    try:
        robot = ElementTree.parse(path).getroot()
        joints = [_joint(element) for element in robot.findall("joint")]
    except (ElementTree.ParseError, ValueError, KeyError, AttributeError, OSError) as error:
        raise InputError(f"{path}: not a readable URDF: {error}") from error
    _check_joints(machine, path, [joint for joint in joints if joint.kind != FIXED])
    if arm.end_effector not in [link.get("name") for link in robot.findall("link")]:
        raise InputError(
            f"{path}: no link {arm.end_effector}, the arm.end_effector of conf/machine/{machine.name}.yaml"
        )
    for name in (arm.yaw_joint, *arm.pitch_joints):
        if name not in machine.joint_names:
            raise InputError(
                f"conf/machine/{machine.name}.yaml: arm names joint {name}, which is not among the joints "
                f"{', '.join(machine.joint_names)}"
            )
    by_child = {joint.child: joint for joint in joints}
    to_base: list[ChainJoint] = []
    link = arm.end_effector
    while link in by_child and len(to_base) < len(joints):  # a circle of links would have no end
        to_base.append(by_child[link])
        link = to_base[-1].parent
    chain = ArmChain(machine, to_base[::-1])
    _check_orientation(machine, path, chain)
    return chain


def _joint(element: ElementTree.Element) -> ChainJoint:
    parent, child = element.find("parent"), element.find("child")
    origin, axis, limit = element.find("origin"), element.find("axis"), element.find("limit")
    direction = _numbers(axis, "xyz", "1 0 0")
    return ChainJoint(
        name=element.attrib["name"],
        kind=JointKind.revolute if element.attrib["type"] == CONTINUOUS else element.attrib["type"],
        parent=parent.attrib["link"],  # type: ignore[union-attr] # read_chain tells of what is missing
        child=child.attrib["link"],  # type: ignore[union-attr]
        position=_numbers(origin, "xyz", "0 0 0"),
        rotation=_rotation(*_numbers(origin, "rpy", "0 0 0")),
        axis=direction / np.linalg.norm(direction),
        limits=(float(_attribute(limit, "lower", "0")), float(_attribute(limit, "upper", "0"))),
    )


def _attribute(element: ElementTree.Element | None, name: str, default: str) -> str:
    return default if element is None else element.get(name, default)


def _numbers(element: ElementTree.Element | None, name: str, default: str) -> np.ndarray:
    numbers = np.array([float(part) for part in _attribute(element, name, default).split()])
    if numbers.shape != (3,):
        raise ValueError(f"{name} has {len(numbers)} numbers instead of 3")
    return numbers


def _rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Of a URDF's `rpy`: turns about the fixed axes x, y and z, in this order."""
    x, y, z = (
        _turns(axis, np.array([angle])) for axis, angle in zip(np.eye(3), (roll, pitch, yaw), strict=True)
    )
    return (z @ y @ x)[0]


def _turns(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rotations about a unit vector by angles of shape (n,), shape (n, 3, 3) (Rodrigues' formula)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, versine = np.sin(angle)[:, None, None], 1.0 - np.cos(angle)[:, None, None]
    return np.eye(3) + sine * cross + versine * (cross @ cross)


def _check_joints(machine: MachineSpecification, path: Path, moving: list[ChainJoint]) -> None:
    found = {joint.name: joint for joint in moving}
    for joint in machine.joints:
        if joint.name not in found:
            raise InputError(f"{path}: no moving joint {joint.name}; it has {', '.join(found)}")
        described = found[joint.name]
        if described.kind != joint.kind:
            raise InputError(
                f"{path}: joint {joint.name} is not {joint.kind}, as conf/machine/{machine.name}.yaml says"
            )
        if np.abs(np.subtract(described.limits, [joint.lower, joint.upper])).max() > LIMIT_TOLERANCE:
            raise InputError(
                f"{path}: joint {joint.name} has limits [{described.limits[0]:g}, {described.limits[1]:g}], "
                f"conf/machine/{machine.name}.yaml has [{joint.lower:g}, {joint.upper:g}]; make them agree"
            )
    for name in found:
        if name not in machine.joint_names:
            raise InputError(
                f"{path}: joint {name} moves but is not a joint of machine {machine.name}; "
                "make it fixed or list it"
            )


def _check_orientation(machine: MachineSpecification, path: Path, chain: ArmChain) -> None:
    """Compare the end effector's frame with the specification's yaw and pitch at both ends of the travel."""
    arm = arm_description(machine)
    q = np.array([machine.lower, machine.upper])
    _, found = chain.forward(q)
    expected = _turns(np.array([0.0, 0.0, 1.0]), chain.yaw(q)) @ _turns(
        np.array([0.0, -1.0, 0.0]), chain.pitch(q)
    )
    trace = np.einsum("nij,nij->n", found, expected)  # 4 (r1 . r2)^2 - 1
    if (0.5 * np.sqrt(np.maximum(0.0, 1.0 + trace)) < 1.0 - ORIENTATION_TOLERANCE).any():
        raise InputError(
            f"{path}: the frame {arm.end_effector} is not turned by yaw about z and then by minus the "
            f"pitch about y, as section arm of conf/machine/{machine.name}.yaml has them; correct its "
            "rpy or the joints' axes"
        )
