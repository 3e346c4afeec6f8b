import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.training.acme import running_statistics, specs
from brax.training.agents.ppo import networks as ppo_networks

from pipeline.control.policy import Policy, load_policy, policy_from_brax, save_policy
from pipeline.errors import InputError

N_OBSERVATION, N_JOINT = 11, 3


@pytest.fixture(scope="module")
def trained():
    """Brax's networks with statistics of some observations."""
    networks = ppo_networks.make_ppo_networks(
        N_OBSERVATION,
        N_JOINT,
        preprocess_observations_fn=running_statistics.normalize,
        policy_hidden_layer_sizes=(8, 16),
    )
    statistics = running_statistics.init_state(specs.Array((N_OBSERVATION,), jnp.dtype("float32")))
    seen = 3.0 + 2.0 * jax.random.normal(jax.random.key(0), (100, N_OBSERVATION))
    statistics = running_statistics.update(statistics, seen)
    return networks, statistics, networks.policy_network.init(jax.random.key(1))


@pytest.fixture(scope="module")
def policy(trained) -> Policy:
    _, statistics, parameters = trained
    return policy_from_brax(statistics, parameters, normalized=True)


def test_acts_as_braxs_deterministic_policy(trained, policy):
    networks, statistics, parameters = trained
    act = ppo_networks.make_inference_fn(networks)((statistics, parameters), deterministic=True)
    observations = jax.random.normal(jax.random.key(2), (50, N_OBSERVATION)) * 3
    expected, _ = act(observations, jax.random.key(0))
    np.testing.assert_allclose(policy.act(observations), expected, atol=1e-6)
    np.testing.assert_allclose(policy.act(observations[0]), expected[0], atol=1e-6)
    assert np.abs(policy.act(observations)).max() <= 1.0


def test_observations_are_left_alone_where_training_did_not_normalise(trained):
    _, statistics, parameters = trained
    policy = policy_from_brax(statistics, parameters, normalized=False)
    np.testing.assert_array_equal(policy.mean, np.zeros(N_OBSERVATION))
    np.testing.assert_array_equal(policy.std, np.ones(N_OBSERVATION))


def test_comes_back_from_its_folder_and_is_byte_stable(policy, tmp_path):
    for name in ("a", "b"):
        save_policy(tmp_path / name, policy, {"seed": 3, "lineage": {"model": "mlp_dqdot"}})
    for file in ("policy.msgpack", "meta.json"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    back, meta = load_policy(tmp_path / "a", "arm")
    jax.tree.map(np.testing.assert_array_equal, back, policy)
    assert (meta["seed"], meta["lineage"]["model"]) == (3, "mlp_dqdot")
    assert (meta["observation_size"], meta["action_size"]) == (N_OBSERVATION, N_JOINT)
    assert (back.observation_size, back.action_size) == (N_OBSERVATION, N_JOINT)


def test_unusable_folders_are_named(policy, tmp_path):
    with pytest.raises(InputError, match=r"absent.*meta\.json"):
        load_policy(tmp_path / "absent", "arm")
    save_policy(tmp_path / "old", policy, {})
    meta = json.loads((tmp_path / "old" / "meta.json").read_text())
    (tmp_path / "old" / "meta.json").write_text(json.dumps({**meta, "schema_version": 0}))
    with pytest.raises(InputError, match="schema_version 0"):
        load_policy(tmp_path / "old", "arm")
    save_policy(tmp_path / "cut", policy, {})
    whole = (tmp_path / "cut" / "policy.msgpack").read_bytes()
    (tmp_path / "cut" / "policy.msgpack").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="cut"):
        load_policy(tmp_path / "cut", "arm")
    save_policy(tmp_path / "list", policy, {})
    (tmp_path / "list" / "meta.json").write_text("[]")
    with pytest.raises(InputError, match=r"list/meta\.json: not a JSON object"):
        load_policy(tmp_path / "list", "arm")
    save_policy(tmp_path / "other", policy, {})
    (tmp_path / "other" / "policy.msgpack").write_bytes(b"\x90")  # an empty list
    with pytest.raises(InputError, match=r"other/policy\.msgpack: holds no policy"):
        load_policy(tmp_path / "other", "arm")
