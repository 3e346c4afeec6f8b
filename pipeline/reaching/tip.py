"""Pose of the chisel tip, component by component: equal to `Arm.forward`, and ten times cheaper.

If quaternions and positions are arrays with a last axis of three or four numbers, the compiler loops over those
numbers. If every component is an array, it makes one vectorised loop over all environments and ticks. Constant
components, such as most of a robot's geometry, are Python numbers, and zeros among them cost nothing.
`Arm.forward` remains the definition (`tests/reaching/test_tip.py`).
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from pipeline.machine.description import RobotDescription
from pipeline.machine.kinematics import Pose

Number = jax.Array | float
Components = tuple[Number, ...]  # of a vector (x, y, z) or a quaternion (w, x, y, z)


def tip_components(description: RobotDescription, q: jax.Array) -> tuple[Components, Components]:
    """Position, m, and unit quaternion of the chisel tip in {B}.

    Args:
        description: the robot description.
        q: configurations, rad (m), (..., n_joint).

    Returns:
        Components, each of shape (...) or a number.
    """
    model = description.model
    position: Components = (0.0, 0.0, 0.0)
    rotation: Components = (1.0, 0.0, 0.0, 0.0)
    for link in _chain(description):
        value = q[..., int(description.joint_order[link])]
        position = _add(position, _rotate(rotation, _numbers(model.body_pos[link + 1])))
        rotation = _multiply(rotation, _numbers(model.body_quat[link + 1]))
        axis, anchor = _numbers(model.jnt_axis[link]), _numbers(model.jnt_pos[link])
        if model.jnt_type[link] == mujoco.mjtJoint.mjJNT_SLIDE:
            position = _add(position, _rotate(rotation, _scale(value, axis)))
            continue
        position = _add(position, _rotate(rotation, anchor))  # the axis passes through the anchor
        rotation = _multiply(rotation, (jnp.cos(0.5 * value), *_scale(jnp.sin(0.5 * value), axis)))
        position = _add(position, _rotate(rotation, _scale(-1.0, anchor)))
    position = _add(position, _rotate(rotation, _numbers(description.end_effector_position)))
    return position, _multiply(rotation, _numbers(description.end_effector_quaternion))


def tip_pose(description: RobotDescription, q: jax.Array) -> Pose:
    """Equal to `Arm.forward`, for configurations (..., n_joint)."""
    position, rotation = tip_components(description, q)
    return Pose(_stacked(position, q), _stacked(rotation, q))


def _chain(description: RobotDescription) -> list[int]:
    """Moving links from the base to the carrier of the tip."""
    links = [description.end_effector_link]
    while (parent := int(description.model.body_parentid[links[-1] + 1]) - 1) >= 0:
        links.append(parent)
    return links[::-1]


def _stacked(components: Components, q: jax.Array) -> jax.Array:
    return jnp.stack([jnp.broadcast_to(value, q.shape[:-1]).astype(q.dtype) for value in components], axis=-1)


def _numbers(values: np.ndarray) -> Components:
    return tuple(float(value) for value in values)


def _sum_of_products(*pairs: tuple[Number, Number]) -> Number:
    total: Number = 0.0
    for a, b in pairs:
        if _is(a, 0.0) or _is(b, 0.0):
            continue
        product = b if _is(a, 1.0) else a if _is(b, 1.0) else a * b
        total = product if _is(total, 0.0) else total + product
    return total


def _is(value: Number, number: float) -> bool:
    return isinstance(value, float) and value == number


def _scale(factor: Number, vector: Components) -> Components:
    return tuple(_sum_of_products((factor, component)) for component in vector)


def _add(a: Sequence[Number], b: Sequence[Number]) -> Components:
    return tuple(_sum_of_products((x, 1.0), (y, 1.0)) for x, y in zip(a, b, strict=True))


def _multiply(a: Components, b: Components) -> Components:
    """Hamilton product."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    _, nx, ny, nz = _scale(-1.0, a)
    return (
        _sum_of_products((aw, bw), (nx, bx), (ny, by), (nz, bz)),
        _sum_of_products((aw, bx), (ax, bw), (ay, bz), (nz, by)),
        _sum_of_products((aw, by), (nx, bz), (ay, bw), (az, bx)),
        _sum_of_products((aw, bz), (ax, by), (ny, bx), (az, bw)),
    )


def _rotate(rotation: Components, vector: Components) -> Components:
    """`vector` turned by a unit quaternion (w, u): v + 2 w (u x v) + 2 u x (u x v)."""
    w, *u = rotation
    twice = _scale(2.0, _cross(u, vector))
    return _add(_add(vector, _scale(w, twice)), _cross(u, twice))


def _cross(a: Sequence[Number], b: Sequence[Number]) -> Components:
    negative = _scale(-1.0, tuple(a))
    return (
        _sum_of_products((a[1], b[2]), (negative[2], b[1])),
        _sum_of_products((a[2], b[0]), (negative[0], b[2])),
        _sum_of_products((a[0], b[1]), (negative[1], b[0])),
    )
