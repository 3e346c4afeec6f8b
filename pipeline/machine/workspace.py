"""The restricted workspace W+ (paper, section "Episodic conditions"; contract, section 1).

W+ is a cylindrical sector about the swing axis: bounds on radius, yaw and height of the chisel tip in {B}.
All bounds are inclusive. The lower plane z = z_min is the height of the grill.
"""

import jax
import jax.numpy as jnp

from pipeline.machine.specification import WorkspaceSpecification


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
