"""A learned reaching policy as an artifact: saving, loading and inference without Brax.

The folder holds `policy.msgpack` (arrays) and `meta.json` (schema version, sizes, and what the caller adds).
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import serialization

from pipeline.effects.store import dynamics_fingerprint
from pipeline.errors import InputError
from pipeline.files.atomic import write_json

POLICY_SCHEMA_VERSION = 1
POLICY_FILE = "policy.msgpack"
META_FILE = "meta.json"


class PolicyLayer(NamedTuple):
    """Affine layer: kernel (n_in, n_out), bias (n_out,)."""

    kernel: jax.Array
    bias: jax.Array


class Policy(NamedTuple):
    """The deterministic part of a policy; a pytree, so it can be an argument of a jitted function.

    Attributes:
        mean: mean of observations in training, shape (n_observation,).
        std: standard deviation of observations in training, shape (n_observation,).
        layers: SiLU between them; the last one gives mean and scale parameter of the action, (2 n_joint,).
    """

    mean: jax.Array
    std: jax.Array
    layers: tuple[PolicyLayer, ...]

    @property
    def observation_size(self) -> int:
        """Dimension of the policy's observations."""
        return self.mean.shape[-1]

    @property
    def action_size(self) -> int:
        """Dimension of its proto-actions."""
        return self.layers[-1].bias.shape[-1] // 2

    @property
    def is_finite(self) -> bool:
        """Whether all weights are numbers; proto-actions that are not would be discretised to rest."""
        return all(bool(jnp.isfinite(leaf).all()) for leaf in jax.tree.leaves(self))

    def act(self, observation: jax.Array) -> jax.Array:
        """Mode of the policy: proto-action (..., n_joint) in (-1, 1) for observations (..., n_observation).

        This is tanh of the mean of the Gaussian, without exploration noise.
        """
        x = (observation - self.mean) / self.std
        for layer in self.layers[:-1]:
            x = jax.nn.silu(x @ layer.kernel + layer.bias)
        last = self.layers[-1]
        n = self.action_size
        return jnp.tanh(x @ last.kernel[:, :n] + last.bias[:n])


def policy_from_brax(normalizer: Any, parameters: Mapping[str, Any], normalized: bool) -> Policy:
    """Extract the policy from the result of Brax's PPO.

    Args:
        normalizer: its running statistics of observations.
        parameters: its policy network's parameters, layers `hidden_0`, `hidden_1`, ...
        normalized: whether observations were normalised in training.
    """
    mean, std = jnp.asarray(normalizer.mean), jnp.asarray(normalizer.std)
    if not normalized:
        mean, std = jnp.zeros_like(mean), jnp.ones_like(std)
    layers = parameters["params"]
    ordered = (layers[f"hidden_{index}"] for index in range(len(layers)))
    return Policy(
        mean,
        std,
        tuple(PolicyLayer(jnp.asarray(layer["kernel"]), jnp.asarray(layer["bias"])) for layer in ordered),
    )


def policy_to_content(policy: Policy) -> dict[str, Any]:
    """The policy's arrays as nested dicts of NumPy arrays, for msgpack."""
    return {
        "mean": np.asarray(policy.mean),
        "std": np.asarray(policy.std),
        "kernels": {str(i): np.asarray(layer.kernel) for i, layer in enumerate(policy.layers)},
        "biases": {str(i): np.asarray(layer.bias) for i, layer in enumerate(policy.layers)},
    }


def policy_from_content(content: Mapping[str, Any]) -> Policy:
    """Inverse of `policy_to_content`."""
    kernels, biases = content["kernels"], content["biases"]
    layers = (
        PolicyLayer(jnp.asarray(kernels[str(i)]), jnp.asarray(biases[str(i)])) for i in range(len(kernels))
    )
    return Policy(jnp.asarray(content["mean"]), jnp.asarray(content["std"]), tuple(layers))


def save_policy(directory: Path, policy: Policy, meta: Mapping[str, Any]) -> None:
    """Write the policy's folder.

    Args:
        directory: created if missing.
        meta: further content of `meta.json` (configuration, lineage); JSON values.
    """
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    (directory / POLICY_FILE).write_bytes(serialization.msgpack_serialize(policy_to_content(policy)))
    sizes = {
        "schema_version": POLICY_SCHEMA_VERSION,
        "observation_size": policy.observation_size,
        "action_size": policy.action_size,
    }
    write_json(directory / META_FILE, {**sizes, **meta}, sort_keys=True)


def load_policy(directory: Path, machine: str) -> tuple[Policy, dict[str, Any]]:
    """Read the folder of a policy of the machine: the policy and the content of its `meta.json`.

    Raises:
        InputError: the folder or one of its files is missing, broken, or of another schema version or machine.
    """
    directory = Path(directory)
    try:
        meta = json.loads((directory / META_FILE).read_text())
        content = serialization.msgpack_restore((directory / POLICY_FILE).read_bytes())
    except FileNotFoundError as error:
        raise InputError(f"{error.filename}: no such file; name a folder that `ppo` or `apg` wrote") from None
    except ValueError as error:
        raise InputError(f"{directory}: not readable as a policy ({error}); train it again") from None
    if not isinstance(meta, dict):
        raise InputError(f"{directory / META_FILE}: not a JSON object; train the policy again")
    if meta.get("schema_version") != POLICY_SCHEMA_VERSION:
        raise InputError(
            f"{directory / META_FILE}: schema_version {meta.get('schema_version')}, this pipeline reads "
            f"{POLICY_SCHEMA_VERSION}; train the policy again"
        )
    if (of := meta.get("machine", machine)) != machine:
        raise InputError(f"{directory}: is of machine {of}, not of {machine}; name a policy of this one")
    try:
        return policy_from_content(content), meta
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{directory / POLICY_FILE}: holds no policy ({error}); train it again") from error


def load_policy_of(directory: Path, model: Path, machine: str) -> Policy:
    """Read a policy of the machine that was learned on the model in the folder `model`.

    Raises:
        InputError: see `load_policy`; or the policy was learned on another model.
    """
    policy, lineage = load_policy(directory, machine)
    if lineage.get("model") != dynamics_fingerprint(model):
        raise InputError(f"{directory}: was not learned on {model}; name the model that it was learned on")
    return policy
