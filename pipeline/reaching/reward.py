"""The reward of the reaching task, term by term (paper, section "Modeling", "Reward function").

Every term is a pure function of errors and works over any leading axes. A term of the tick from t to t+1 is
computed from the pose at t+1 and from the command a_t.
"""

import enum
import functools
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp

from pipeline.errors import InputError


class RewardTerm(enum.StrEnum):
    """The summands of Eq. reward_function; an ablation or a variant is a subset of them."""

    pose = "pose"  # r^X
    configuration = "configuration"  # r^q
    precision = "precision"  # r^epsilon, all three bonuses
    action = "action"  # r^a
    workspace = "workspace"  # r^W+


@dataclass
class RewardConfig:
    """Section `reward` of a profile: the constants of the paper's table, and the summed terms.

    Thresholds are strict upper bounds: of distances in m, of the geodesic distance in half turns, and of
    *squared* errors where the name ends in `rad2`.
    """

    terms: list[RewardTerm]
    position_weight: float
    rotation_weight: float
    configuration_weight: float
    action_weight: float
    workspace_weight: float
    position_threshold_m: float
    rotation_threshold: float
    fine_position_threshold_m: float
    fine_rotation_threshold: float
    angle_threshold_rad2: float
    configuration_threshold_rad2: float
    pose_bonus: float
    angle_bonus: float
    configuration_bonus: float

    def __post_init__(self) -> None:
        self.terms = [RewardTerm(term) for term in self.terms]
        if not self.terms or len(set(self.terms)) != len(self.terms):
            raise InputError(
                f"reward.terms is {[str(term) for term in self.terms]}; list each wanted term once"
            )
        for name, value in vars(self).items():
            if name != "terms" and value <= 0:
                raise InputError(
                    f"reward.{name} is {value}; it must be positive (leave a term out by `terms`)"
                )


class Deviation(NamedTuple):
    """Deviation of a pose and its configuration from the target's.

    Attributes:
        position: d, Euclidean distance, m, shape (...).
        rotation: d_g, geodesic distance in half turns, in [0, 1], shape (...).
        yaw: signed difference, rad, shape (...).
        pitch: signed difference, rad, shape (...).
        configuration: q - q_target, rad (m), shape (..., n_joint).
    """

    position: jax.Array
    rotation: jax.Array
    yaw: jax.Array
    pitch: jax.Array
    configuration: jax.Array


class RewardTerms(NamedTuple):
    """Value of each term, weighted, shape (...). The fields are the members of `RewardTerm`."""

    pose: jax.Array
    configuration: jax.Array
    precision: jax.Array
    action: jax.Array
    workspace: jax.Array


def euclidean_norm(vector: jax.Array) -> jax.Array:
    """Norm over the last axis, with gradient 0 at the origin instead of NaN."""
    # Component by component, here and in `configuration_is_precise`: a reduction over an axis of three or four
    # numbers is a loop that the compiler does not vectorise.
    squared = sum(vector[..., index] ** 2 for index in range(vector.shape[-1]))
    at_origin = squared == 0.0
    return jnp.where(at_origin, 0.0, jnp.sqrt(jnp.where(at_origin, 1.0, squared)))


def geodesic_distance(target: jax.Array, quaternion: jax.Array) -> jax.Array:
    """d_g, the normalised geodesic distance between two orientations, shape (...), in [0, 1].

    Written as (4/π) atan2(|r - r'|, |r + r'|) with the nearer sign of r' (Kahan): the same function as the
    paper's (1/π) arccos(2 (r·r')² - 1) for unit quaternions of shape (..., 4), but arccos loses half of
    float32's digits next to 1, has an infinite gradient there, and is NaN once rounding carries its argument
    beyond 1.
    """
    difference = euclidean_norm(target - quaternion)
    total = euclidean_norm(target + quaternion)
    nearer, farther = jnp.minimum(difference, total), jnp.maximum(difference, total)
    return 4.0 / jnp.pi * jnp.arctan2(nearer, farther)


def pose_penalty(config: RewardConfig, deviation: Deviation) -> jax.Array:
    """r^X = -λ_p d - λ_r d_g."""
    return -config.position_weight * deviation.position - config.rotation_weight * deviation.rotation


def configuration_penalty(config: RewardConfig, deviation: Deviation) -> jax.Array:
    """r^q = -λ_q ‖q - q_target‖."""
    return -config.configuration_weight * euclidean_norm(deviation.configuration)


def pose_is_precise(
    deviation: Deviation, position_threshold_m: float, rotation_threshold: float
) -> jax.Array:
    """b_X (Eq. b_pose), boolean."""
    return (deviation.position < position_threshold_m) & (deviation.rotation < rotation_threshold)


def angles_are_precise(deviation: Deviation, threshold_rad2: float) -> jax.Array:
    """b_alpha (Eq. b_angle), boolean: squared yaw and pitch errors are both below the threshold."""
    return (deviation.yaw**2 < threshold_rad2) & (deviation.pitch**2 < threshold_rad2)


def configuration_is_precise(deviation: Deviation, threshold_rad2: float) -> jax.Array:
    """b_q (Eq. b_q), boolean: the squared error of every joint is below the threshold."""
    errors = deviation.configuration
    precise = [errors[..., joint] ** 2 < threshold_rad2 for joint in range(errors.shape[-1])]
    return functools.reduce(jnp.logical_and, precise)


def precision_bonus(config: RewardConfig, deviation: Deviation) -> jax.Array:
    """r^epsilon (Eq. accuracy_bonus): coarse and fine pose, angles, configuration."""
    coarse = pose_is_precise(deviation, config.position_threshold_m, config.rotation_threshold)
    fine = pose_is_precise(deviation, config.fine_position_threshold_m, config.fine_rotation_threshold)
    angles = angles_are_precise(deviation, config.angle_threshold_rad2)
    configuration = configuration_is_precise(deviation, config.configuration_threshold_rad2)
    return (
        config.pose_bonus * (coarse.astype(jnp.float32) + fine.astype(jnp.float32))
        + config.angle_bonus * angles
        + config.configuration_bonus * configuration
    )


def action_penalty(config: RewardConfig, command: jax.Array, previous_command: jax.Array) -> jax.Array:
    """r^a = -λ_a mean over joints of |a_t - a_{t-1}|; the paper's 1/4 is one over its number of joints."""
    return -config.action_weight * jnp.mean(jnp.abs(command - previous_command), axis=-1)


def workspace_penalty(config: RewardConfig, inside: jax.Array) -> jax.Array:
    """r^W+ = -λ_W+ wherever the pose is outside W+; `inside` is boolean."""
    return jnp.where(inside, 0.0, -config.workspace_weight)


def reward_terms(
    config: RewardConfig,
    deviation: Deviation,
    command: jax.Array,
    previous_command: jax.Array,
    inside: jax.Array,
) -> RewardTerms:
    """All terms of one tick, whether enabled or not.

    Args:
        config: weights and thresholds.
        deviation: deviation of the pose after the tick.
        command: a_t, shape (..., n_joint).
        previous_command: a_{t-1}, of the tick before.
        inside: whether the pose after the tick lies in W+, boolean, shape (...).
    """
    return RewardTerms(
        pose=pose_penalty(config, deviation),
        configuration=configuration_penalty(config, deviation),
        precision=precision_bonus(config, deviation),
        action=action_penalty(config, command, previous_command),
        workspace=workspace_penalty(config, inside),
    )


def total_reward(config: RewardConfig, terms: RewardTerms) -> jax.Array:
    """r_t (Eq. reward_function): the sum of the terms that `config.terms` lists."""
    return sum((getattr(terms, term) for term in config.terms), start=jnp.zeros_like(terms.pose))
