"""The policy's network while it is trained: the same layers, with a first one that is laid out for reaching."""

import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.control.policy import Policy, PolicyLayer
from pipeline.reaching.task import ReachingTask

LAST_GAIN = (
    0.1  # of the last layer's initial weights: proto-actions begin near zero, so the arm begins at rest
)


def initial_layers(key: jax.Array, n_in: int, hidden: Sequence[int], n_joint: int) -> tuple[PolicyLayer, ...]:
    """Orthogonal kernels and zero biases; `key` is consumed. The last layer is as wide as `Policy` wants it."""
    widths = (n_in, *hidden, 2 * n_joint)
    gains = [math.sqrt(2.0)] * len(hidden) + [LAST_GAIN]
    keys = jax.random.split(key, len(gains))
    return tuple(
        PolicyLayer(jax.nn.initializers.orthogonal(gain)(key, (n_in, n_out)), jnp.zeros(n_out))
        for key, gain, n_in, n_out in zip(keys, gains, widths, widths[1:], strict=False)
    )


def error_inputs(task: ReachingTask, gain: float) -> np.ndarray:
    """Linear map from observations to the inputs of the trained first layer, (n_observation, n_observation).

    The entries of the target become `gain` times their differences from the present ones. A centimetre then moves an
    input as far as a decimetre does otherwise. The map is one to one: it changes the scale of weights, not the policies
    that there are.
    """
    n_joint, n_pose = task.machine.n_joint, 3 + 4
    now = task.dynamics.specification.n_features  # where `ReachingTask.observe` has the pose
    configuration = now + 2 * n_pose
    inputs = np.eye(task.observation_size, dtype=np.float32)
    for present, target, n in (
        (now, now + n_pose, n_pose),
        (configuration, configuration + n_joint, n_joint),
    ):
        columns = np.arange(target, target + n)
        inputs[columns, columns] = gain
        inputs[np.arange(present, present + n), columns] = -gain
    return inputs


def as_policy(layers: Sequence[PolicyLayer], inputs: np.ndarray) -> Policy:
    """The policy of observations, with the map of `error_inputs` in its first layer."""
    first, *others = layers
    n = len(inputs)
    folded = PolicyLayer(jnp.asarray(inputs) @ first.kernel, first.bias)
    return Policy(jnp.zeros(n), jnp.ones(n), (folded, *others))


def layers_of(policy: Policy, inputs: np.ndarray) -> tuple[PolicyLayer, ...]:
    """Layers to train a policy further with: inverse of `as_policy`, the policy's normalisation folded in."""
    (kernel, bias), *others = policy.layers
    scaled = kernel / policy.std[:, None]
    return PolicyLayer(jnp.linalg.solve(inputs, scaled), bias - policy.mean @ scaled), *others
