"""The arm's kinematic chain, read from its URDF and checked against the machine's specification; what its tip meets."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from pipeline.errors import InputError
from pipeline.machine.components import Components, about, multiply
from pipeline.machine.specification import ArmDescription, JointKind, MachineSpecification

LIMIT_TOLERANCE = 1e-6  # rad or m: limits closer than this agree
FIXED, CONTINUOUS = "fixed", "continuous"
FLOOR, BASE_EDGE = "floor", "base_edge"  # links


@dataclass(frozen=True)
class ChainJoint:
    """A joint of the URDF, which may be fixed.

    Attributes:
        name: In the URDF.
        kind: The URDF's word; a continuous joint is a revolute one.
        parent: Link that carries it.
        child: Link that it carries.
        position: Of the child's frame in the parent's at zero, m.
        quaternion: The same frame's orientation (w, x, y, z).
        axis: Unit vector in the child's frame.
        limits: Lower and upper, rad or m; zeros where the URDF has none.
    """

    name: str
    kind: str
    parent: str
    child: str
    position: Components
    quaternion: Components
    axis: Components
    limits: tuple[float, float]


class Surfaces(NamedTuple):
    """What the tip meets, in frame {B}, m: the ground, or a grill on it, and the base, an upright cylinder about z.

    The robot description tells them by two empty links at the end of fixed joints: `floor` lies on the ground or the
    grill, `base_edge` on the upper edge of the base. Without the first the ground is z = 0, without the second there
    is no base.
    """

    floor_m: float = 0.0
    base_radius_m: float = 0.0
    base_height_m: float = 0.0

    def gap(self, position: np.ndarray) -> np.ndarray:
        """From positions of the tip (..., 3), m, to the nearest surface: (...), m; negative inside."""
        height, radius = position[..., 2], np.hypot(position[..., 0], position[..., 1])
        of_base = np.maximum(height - self.base_height_m, radius - self.base_radius_m)
        return np.asarray(np.minimum(height - self.floor_m, of_base))


GROUND = Surfaces()  # alone


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


def read_chain(machine: MachineSpecification, directory: Path) -> list[ChainJoint]:
    """Read the joints from the base to the chisel tip, and check that the URDF describes this machine.

    Args:
        machine: the machine; its `arm` section names the URDF and the frame of the chisel tip.
        directory: where conf/machine lies.

    Raises:
        InputError: the URDF is missing or unreadable; a joint of the machine is missing in it, has another
            kind or other limits; it has a further moving joint; or it lacks the end effector.
    """
    arm = arm_description(machine)
    path = urdf_path(machine, directory)
    joints = read_joints(path)
    by_child = {joint.child: joint for joint in joints}
    _check_joints(machine, path, [joint for joint in joints if joint.kind != FIXED])
    if arm.end_effector not in by_child:
        raise InputError(
            f"{path}: no link {arm.end_effector}, the arm.end_effector of conf/machine/{machine.name}.yaml"
        )
    for name in (arm.yaw_joint, *arm.pitch_joints):
        if name not in machine.joint_names:
            raise InputError(
                f"conf/machine/{machine.name}.yaml: arm names joint {name}, which is not among the joints "
                f"{', '.join(machine.joint_names)}"
            )
    to_base: list[ChainJoint] = []
    link = arm.end_effector
    while link in by_child and len(to_base) < len(joints):  # a circle of links would have no end
        to_base.append(by_child[link])
        link = to_base[-1].parent
    return to_base[::-1]


def read_joints(path: Path) -> list[ChainJoint]:
    """All joints of a robot description, in its order.

    Raises:
        InputError: it is not a readable URDF.
    """
    try:
        return [_joint(element) for element in ElementTree.parse(path).getroot().findall("joint")]
    except (ElementTree.ParseError, ValueError, KeyError, AttributeError, OSError) as error:
        raise InputError(f"{path}: not a readable URDF: {error}") from error


def read_surfaces(path: Path) -> Surfaces:
    """Of a robot description.

    Raises:
        InputError: it is not a readable URDF.
    """
    at = {joint.child: joint.position for joint in read_joints(path)}
    x, y, base_height_m = at.get(BASE_EDGE, (0.0, 0.0, 0.0))
    return Surfaces(at.get(FLOOR, (0.0, 0.0, 0.0))[2], float(np.hypot(x, y)), base_height_m)


def _joint(element: ElementTree.Element) -> ChainJoint:
    parent, child = element.find("parent"), element.find("child")
    origin, axis, limit = element.find("origin"), element.find("axis"), element.find("limit")
    direction = _numbers(axis, "xyz", "1 0 0")
    return ChainJoint(
        name=element.attrib["name"],
        kind=JointKind.revolute if element.attrib["type"] == CONTINUOUS else element.attrib["type"],
        parent=parent.attrib["link"],  # type: ignore[union-attr] # read_joints tells of what is missing
        child=child.attrib["link"],  # type: ignore[union-attr]
        position=tuple(_numbers(origin, "xyz", "0 0 0")),
        quaternion=_orientation(*_numbers(origin, "rpy", "0 0 0")),
        axis=tuple((np.array(direction) / np.linalg.norm(direction)).tolist()),
        limits=(float(_attribute(limit, "lower", "0")), float(_attribute(limit, "upper", "0"))),
    )


def _attribute(element: ElementTree.Element | None, name: str, default: str) -> str:
    return default if element is None else element.get(name, default)


def _numbers(element: ElementTree.Element | None, name: str, default: str) -> list[float]:
    numbers = [float(part) for part in _attribute(element, name, default).split()]
    if len(numbers) != 3:
        raise ValueError(f"{name} has {len(numbers)} numbers instead of 3")
    return numbers


def _orientation(roll: float, pitch: float, yaw: float) -> Components:
    """Of a URDF's `rpy`: turns about the fixed axes x, y and z, in this order."""
    x, y, z = (about(np.eye(3)[axis], angle) for axis, angle in enumerate((roll, pitch, yaw)))
    return multiply(z, multiply(y, x))


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
