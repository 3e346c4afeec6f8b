"""Start and target poses of the reaching task (paper, section "Episodic conditions").

Poses are drawn as configurations, uniformly over the box of joint limits, and kept if their pose lies in W+
and meets the conditions. The paper selects "a random initial configuration ... such that" these hold, and its
observations and reward need a target's configuration beside its pose; uniform in configuration space gives
both without inverse kinematics, and covers the joints' ranges evenly. In W+ itself the density is
therefore not uniform: it goes with the inverse of the Jacobian's determinant, so it is higher near the swing
axis and near full stretch.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp

from pipeline.errors import InputError
from pipeline.machine.kinematics import Arm, Pose
from pipeline.machine.specification import MachineSpecification
from pipeline.machine.workspace import contains, workspace_of

_CANDIDATES_PER_ROUND = 8192  # a round costs milliseconds
_MINIMUM_ROUNDS = 64  # before a search is given up
_MINIMUM_ACCEPTANCE = 1e-3  # conditions that fewer candidates than this share satisfy are an error


@dataclass
class PoseConditions:
    """What a sampled pose must meet besides lying in W+.

    `pitch_max_rad` bounds the pitch on both sides. `z_min_m` and `z_max_m` bound the tip's height in {B}
    further than W+ does (targets in evaluation); None leaves W+'s own bounds.
    """

    pitch_max_rad: float
    z_min_m: float | None
    z_max_m: float | None

    def __post_init__(self) -> None:
        if not 0.0 < self.pitch_max_rad <= math.pi:
            raise InputError(f"pitch_max_rad is {self.pitch_max_rad}; it must be in (0, pi]")
        if self.z_min_m is not None and self.z_max_m is not None and not self.z_min_m < self.z_max_m:
            raise InputError(f"z_min_m {self.z_min_m} is not below z_max_m {self.z_max_m}")


def satisfies(machine: MachineSpecification, arm: Arm, conditions: PoseConditions, q: jax.Array) -> jax.Array:
    """Whether configurations have poses in W+ that meet the conditions.

    Args:
        machine: the machine; its workspace is W+.
        conditions: bounds on pitch and height.
        q: configurations, rad (m), shape (..., n_joint).

    Returns:
        Boolean array, shape (...).

    Raises:
        InputError: the machine has no workspace.
    """
    position = arm.forward(q).position
    accepted = contains(workspace_of(machine), position, arm.yaw(q))
    accepted &= jnp.abs(arm.pitch(q)) <= conditions.pitch_max_rad
    if conditions.z_min_m is not None:
        accepted &= position[..., 2] >= conditions.z_min_m
    if conditions.z_max_m is not None:
        accepted &= position[..., 2] <= conditions.z_max_m
    return accepted


class _Sampling(NamedTuple):
    """State of the rejection loop: key, buffer (n, n_joint), configurations found and rounds done so far."""

    key: jax.Array
    buffer: jax.Array
    n_found: jax.Array
    n_rounds: jax.Array


def _sample(
    key: jax.Array, machine: MachineSpecification, arm: Arm, conditions: PoseConditions, n: int
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Rejection sampling until `n` are found or the rounds are used up: buffer, number found, rounds used."""
    lower, upper = jnp.asarray(machine.lower, jnp.float32), jnp.asarray(machine.upper, jnp.float32)
    maximum_rounds = _MINIMUM_ROUNDS + math.ceil(n / (_MINIMUM_ACCEPTANCE * _CANDIDATES_PER_ROUND))

    def unfinished(state: _Sampling) -> jax.Array:
        return (state.n_found < n) & (state.n_rounds < maximum_rounds)

    def add_round(state: _Sampling) -> _Sampling:
        key, draw = jax.random.split(state.key)
        q = jax.random.uniform(draw, (_CANDIDATES_PER_ROUND, machine.n_joint), minval=lower, maxval=upper)
        accepted = satisfies(machine, arm, conditions, q)
        # accepted candidates go to the next free rows, in order; the others, and those too many, are dropped
        row = jnp.where(accepted, state.n_found + jnp.cumsum(accepted) - 1, n)
        buffer = state.buffer.at[row].set(q, mode="drop")
        return _Sampling(key, buffer, state.n_found + accepted.sum(), state.n_rounds + 1)

    start = _Sampling(key, jnp.zeros((n, machine.n_joint), jnp.float32), jnp.int32(0), jnp.int32(0))
    end = jax.lax.while_loop(unfinished, add_round, start)
    return end.buffer, end.n_found, end.n_rounds


def _sample_checked(
    key: jax.Array, machine: MachineSpecification, arm: Arm, conditions: PoseConditions, n: int
) -> tuple[jax.Array, float]:
    workspace_of(machine)
    buffer, n_found, n_rounds = jax.jit(lambda k: _sample(k, machine, arm, conditions, n))(key)
    n_candidates = int(n_rounds) * _CANDIDATES_PER_ROUND
    if int(n_found) < n:
        raise InputError(
            f"machine {machine.name}: {int(n_found)} of {n_candidates} configurations within the limits "
            f"have poses in W+ that satisfy {conditions}; widen the conditions or correct the workspace"
        )
    return buffer, int(n_found) / n_candidates


def sample_configurations(
    key: jax.Array, machine: MachineSpecification, arm: Arm, conditions: PoseConditions, n: int
) -> jax.Array:
    """Configurations drawn uniformly over the joint limits, given that their poses satisfy the conditions.

    Outside `jit` (it checks that it succeeded); inside, use a `PoseTable`.

    Args:
        key: JAX key; the same key gives the same configurations.
        conditions: bounds on pitch and height, besides W+.
        n: how many.

    Returns:
        Configurations, shape (n, n_joint), float32, rad (m).

    Raises:
        InputError: hardly any configuration satisfies the conditions, or the machine has no workspace.
    """
    return _sample_checked(key, machine, arm, conditions, n)[0]


class PoseTable(NamedTuple):
    """Configurations drawn beforehand, with their poses, from which a jitted loop draws at random.

    A draw costs one random integer and one row instead of a rejection loop, which under `vmap` would run as
    often as its unluckiest lane. 2**17 rows are adequate for learning on bobcat_e10. An episode draws start
    and target independently, so there are 2**34 pairs against some 10**6 episodes in the paper's 4e8 steps:
    hardly a pair repeats. And a fresh configuration lies 0.04 rad (median, Euclidean over the joints; 99 %:
    0.07 rad) from the nearest row, about what one joint moves in a control period at full speed, so the table
    has no gaps to learn around.

    Attributes:
        configurations: shape (n, n_joint), rad (m).
        positions: of the chisel tip in {B}, shape (n, 3), m.
        quaternions: shape (n, 4), (w, x, y, z).
        acceptance_rate: share of the uniformly drawn candidates that satisfied the conditions.
    """

    configurations: jax.Array
    positions: jax.Array
    quaternions: jax.Array
    acceptance_rate: float

    def draw(self, key: jax.Array) -> tuple[jax.Array, Pose]:
        """One configuration, shape (n_joint,), and its pose, uniformly from the table; works inside `jit`."""
        row = jax.random.randint(key, (), 0, self.configurations.shape[0])
        return self.configurations[row], Pose(self.positions[row], self.quaternions[row])


def build_pose_table(
    key: jax.Array, machine: MachineSpecification, arm: Arm, conditions: PoseConditions, n: int
) -> PoseTable:
    """Draws the table's `n` configurations as `sample_configurations` does, and computes their poses.

    Raises:
        InputError: as `sample_configurations`.
    """
    configurations, acceptance_rate = _sample_checked(key, machine, arm, conditions, n)
    pose = jax.jit(arm.forward)(configurations)
    return PoseTable(configurations, pose.position, pose.quaternion, acceptance_rate)
