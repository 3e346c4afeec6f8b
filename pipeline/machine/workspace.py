"""The restricted workspace W+ (paper, section "Episodic conditions"; contract, section 1).

W+ is a cylindrical sector about the swing axis: bounds on radius, yaw and height of the chisel tip in {B}.
All bounds are inclusive. The lower plane z = z_min is the height of the grill. The envelope of experiments is W+, as an
operator widens it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.errors import InputError
from pipeline.machine.kinematics import Arm
from pipeline.machine.specification import MachineSpecification, WorkspaceSpecification


def contains(workspace: WorkspaceSpecification, position: jax.Array, yaw: jax.Array) -> jax.Array:
    """Whether poses lie in W+.

    `yaw` is that of the pose, i.e. of the arm's plane (the swing angle), which for a tip in front of the
    swing axis is also the azimuth atan2(y, x) of its position. An arm folded back until its tip is behind the
    axis has an azimuth of yaw + pi; it is outside, although its radius and its yaw are within bounds.

    Args:
        workspace: bounds of W+.
        position: of the chisel tip in {B}, m, shape (..., 3).
        yaw: rad, shape (...).

    Returns:
        Boolean array, shape (...).
    """
    x, y, z = position[..., 0], position[..., 1], position[..., 2]
    radius = jnp.hypot(x, y)
    in_front = x * jnp.cos(yaw) + y * jnp.sin(yaw) > 0.0
    return (
        (radius >= workspace.radius_min_m)
        & (radius <= workspace.radius_max_m)
        & (jnp.abs(yaw) <= workspace.yaw_max_rad)
        & in_front
        & (z >= workspace.z_min_m)
        & (z <= workspace.z_max_m)
    )


def below_lower_plane(workspace: WorkspaceSpecification, position: jax.Array) -> jax.Array:
    """Whether positions lie below the lower plane of W+, which the metric OOZ counts (paper, section
    "Synthesis and evaluation of controllers for reaching").

    Args:
        workspace: bounds of W+.
        position: of the chisel tip in {B}, m, shape (..., 3).

    Returns:
        Boolean array, shape (...). Every true entry is also outside W+, so OOZ never exceeds OOW.
    """
    return position[..., 2] < workspace.z_min_m


def depths(workspace: WorkspaceSpecification, position: jax.Array, yaw: jax.Array) -> tuple[jax.Array, ...]:
    """How far poses lie inside each face of W+, m, each of shape (...); negative outside.

    Arguments as of `contains`. The radius is that along the arm's plane, so an arm folded back lies outside. The depth
    inside the two faces of constant yaw is taken along the circle.
    """
    radius = position[..., 0] * jnp.cos(yaw) + position[..., 1] * jnp.sin(yaw)
    return (
        radius - workspace.radius_min_m,
        workspace.radius_max_m - radius,
        radius * (workspace.yaw_max_rad - jnp.abs(yaw)),
        position[..., 2] - workspace.z_min_m,
        workspace.z_max_m - position[..., 2],
    )


def workspace_of(machine: MachineSpecification) -> WorkspaceSpecification:
    """The machine's `workspace` section.

    Raises:
        InputError: the specification has no such section.
    """
    if machine.workspace is None:
        raise InputError(
            f"conf/machine/{machine.name}.yaml: no section workspace; the reaching task needs one"
        )
    return machine.workspace


@dataclass
class EnvelopeConfig:
    """The region in which experiments are planned: W+, unless the operator widens it.

    Attributes:
        wider_m: by which the bounds of radius and height lie further out than those of W+.
        wider_rad: the same of the yaw.
        joints: lowest and highest angle of a joint by its name, rad (m), beside the region of the tip.
    """

    wider_m: float
    wider_rad: float
    joints: dict[str, list[float]]

    def __post_init__(self) -> None:
        for name, bounds in self.joints.items():
            if len(bounds) != 2 or not bounds[0] < bounds[1]:
                raise InputError(
                    f"envelope.joints.{name} is {list(bounds)}; give the lowest and the highest angle"
                )
        for name in ("wider_m", "wider_rad"):
            if not getattr(self, name) >= 0:
                raise InputError(f"envelope.{name} is {getattr(self, name)}; it must not be negative")


class Envelope:
    """W+, widened as the operator says, and bounds of joints beside it.

    Attributes:
        lower: (n_joint,) bounds of joints, rad (m); minus infinity where there are none.
        upper: likewise.
    """

    def __init__(self, machine: MachineSpecification, arm: Arm | None, config: EnvelopeConfig) -> None:
        """The region of a machine.

        Args:
            machine: with a section `workspace`, if it has an arm.
            arm: its kinematics; None: the region has bounds of joints alone.
            config: how it differs from W+.

        Raises:
            InputError: the machine has no W+, or a bound names another joint.
        """
        self.lower = np.full(machine.n_joint, -np.inf)
        self.upper = np.full(machine.n_joint, np.inf)
        for name, bounds in config.joints.items():
            if name not in machine.joint_names:
                known = ", ".join(machine.joint_names)
                raise InputError(f"envelope.joints: no joint `{name}`; known are {known}")
            joint = machine.joint_names.index(name)
            self.lower[joint], self.upper[joint] = bounds
        self._limits = machine.lower, machine.upper
        self._contains = None if arm is None else _tip_inside(machine, arm, config)
        self.holds(machine.lower)  # compiled before the first state comes

    def ahead(self, q: np.ndarray, velocity: np.ndarray, seconds: float) -> np.ndarray:
        """Where joints would be in so many seconds at this velocity, (..., n_joint), rad (m); stops hold them."""
        return np.clip(q + seconds * velocity, *self._limits)

    def holds(self, q: np.ndarray) -> bool:
        """Whether a configuration (n_joint,), rad (m), lies in the region."""
        return bool(self.holds_each(q))

    def holds_each(self, q: np.ndarray) -> np.ndarray:
        """Whether configurations (..., n_joint), rad (m), lie in the region: (...,) bool."""
        q = np.asarray(q)
        bounded = ((q >= self.lower) & (q <= self.upper)).all(axis=-1)
        if self._contains is None:
            return np.asarray(bounded)
        return np.asarray(bounded & np.asarray(self._contains(q.astype(np.float32))))


def _tip_inside(
    machine: MachineSpecification, arm: Arm, config: EnvelopeConfig
) -> Callable[[np.ndarray], jax.Array]:
    workspace, wider_m = workspace_of(machine), config.wider_m
    region = replace(
        workspace,
        radius_min_m=max(workspace.radius_min_m - wider_m, 0.0),
        radius_max_m=workspace.radius_max_m + wider_m,
        yaw_max_rad=workspace.yaw_max_rad + config.wider_rad,
        z_min_m=workspace.z_min_m - wider_m,
        z_max_m=workspace.z_max_m + wider_m,
    )
    return jax.jit(lambda q: contains(region, arm.forward(q).position, arm.yaw(q)))
