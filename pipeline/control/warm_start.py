"""A policy that PPO trains further, in Brax's form."""

import math
from dataclasses import dataclass
from typing import Any

import jax

import pipeline.machine.quiet_mjx  # noqa: F401 # isort: skip (before Brax)
from brax.training.acme import running_statistics

from pipeline.control.policy import Policy, PolicyLayer
from pipeline.errors import InputError


@dataclass
class WarmStartConfig:
    """Section `warm_start` of a profile: what is other than in `ppo` where a policy is trained further.

    Attributes:
        training_steps: as of `PPOConfig`; the last policy is kept.
        learning_rate: of Adam, at the start.
        final_learning_rate: at `training_steps`.
        deviation: of the noise on proto-actions with which exploration begins.
    """

    training_steps: int
    learning_rate: float
    final_learning_rate: float
    deviation: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0:
                raise InputError(f"warm_start.{name} is {value}; it must be positive")


def policy_to_brax(policy: Policy, deviation: float) -> tuple[Any, dict[str, Any], None]:
    """A policy as Brax restores it where observations are not normalised: statistics, the network, and no critic.

    Args:
        policy: its normalisation becomes part of its first layer.
        deviation: of the noise, the same for all joints and observations; Brax adds `min_std` to it.
    """
    (kernel, bias), *others = policy.layers
    scaled = kernel / policy.std[:, None]
    layers = [PolicyLayer(scaled, bias - policy.mean @ scaled), *others]
    noise = slice(policy.action_size, None)  # Brax's deviation is softplus of these outputs
    last = layers[-1]
    layers[-1] = PolicyLayer(
        last.kernel.at[:, noise].set(0.0), last.bias.at[noise].set(math.log(math.expm1(deviation)))
    )
    statistics = running_statistics.init_state(jax.ShapeDtypeStruct(policy.mean.shape, policy.mean.dtype))
    return statistics, {"params": {f"hidden_{i}": layer._asdict() for i, layer in enumerate(layers)}}, None
