"""Yaw and pitch of the chisel, and the quaternions that stand for them.

The roll of the hammer is fixed by its kinematics (paper, section "Modeling", reward function), so an
orientation is yaw and pitch: a turn by yaw about z of {B}, then by *minus* the pitch about the turned y axis.
Zero pitch is the chisel straight down; positive pitch swings the tip outwards, as positive boom, arm and
bucket angles do. At zero yaw and zero pitch the chisel's frame is that of {B}, and the chisel points along
its -z.
"""

import jax
import jax.numpy as jnp


def quaternion_from_yaw_pitch(yaw: jax.Array, pitch: jax.Array) -> jax.Array:
    """Orientation of the chisel tip in {B}.

    Continuous in both angles: of the two quaternions of an orientation it gives the one that the arm's own
    kinematics gives, so a pose from elsewhere should pass through `yaw_pitch` and this function.

    Args:
        yaw: rad, any shape.
        pitch: rad, shape broadcastable with `yaw`.

    Returns:
        Unit quaternion (w, x, y, z), shape (..., 4).
    """
    half_yaw, half_pitch = jnp.broadcast_arrays(0.5 * jnp.asarray(yaw), 0.5 * jnp.asarray(pitch))
    cos_yaw, sin_yaw = jnp.cos(half_yaw), jnp.sin(half_yaw)
    cos_pitch, sin_pitch = jnp.cos(half_pitch), jnp.sin(half_pitch)
    return jnp.stack(
        [cos_yaw * cos_pitch, sin_yaw * sin_pitch, -cos_yaw * sin_pitch, sin_yaw * cos_pitch], axis=-1
    )


def yaw_pitch(quaternion: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Yaw and pitch of an orientation, whichever sign its quaternion has.

    Yaw is the heading of the frame's y axis, which the pitch does not move: unlike the heading of the chisel
    it stays defined at every pitch. A roll, which the hammer cannot have, is ignored.

    Args:
        quaternion: (w, x, y, z), shape (..., 4), of any length but zero.

    Returns:
        Yaw and pitch in rad, each of shape (...), in (-pi, pi].
    """
    w, x, y, z = jnp.moveaxis(jnp.asarray(quaternion), -1, 0)
    # y axis of the frame: (2 (xy - wz), w^2 - x^2 + y^2 - z^2, ...)
    yaw = jnp.arctan2(2.0 * (w * z - x * y), w * w - x * x + y * y - z * z)
    # the frame's z axis, (sin, cos) of minus the pitch in the vertical plane of that yaw
    z_axis_x, z_axis_y = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x)
    outwards = z_axis_x * jnp.cos(yaw) + z_axis_y * jnp.sin(yaw)
    pitch = -jnp.arctan2(outwards, w * w - x * x - y * y + z * z)
    return yaw, pitch
