"""Both step equations and both networks against the NumPy reference; alignment of commands and velocities."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxkan.layers.Legendre import LegendreLayer

from pipeline.dynamics.model.dynamics import Dynamics
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import KolmogorovArnoldNetwork, apply
from pipeline.dynamics.model.rollouts.open_loop import rollout
from pipeline.errors import InputError
from tests.dynamics import reference
from tests.dynamics.conftest import LAGS, make_specification, random_trajectory

T, H = 7, 6


@pytest.fixture(scope="module")
def log():
    return random_trajectory(2, n_rows=T + H + 1)


def history_and_commands(model, log):
    rows = [jnp.asarray(array[: T + 1]) for array in (log.q, log.qd, log.a)]
    return model.history_from_rows(*rows), jnp.asarray(log.a[T : T + H])


@pytest.mark.parametrize("predict", [Dynamics.roll_out, rollout])
def test_rollout_follows_the_paper(model, parameters, log, predict):
    expected = reference.rollout(model.specification, parameters, log.q, log.qd, log.a, T, H)
    with jax.enable_x64(True):
        predicted = jax.jit(partial(predict, model))(parameters, *history_and_commands(model, log))
    np.testing.assert_allclose(predicted[0], expected[0], rtol=0, atol=1e-13)  # alignment at step 0
    np.testing.assert_allclose(predicted[1], expected[1], rtol=0, atol=1e-13)  # alignment at step 1
    np.testing.assert_allclose(predicted, expected, rtol=0, atol=1e-12)


def test_step_appends_the_new_velocity_or_position_and_the_command(model, parameters, log):
    with jax.enable_x64(True):
        history, commands = history_and_commands(model, log)
        after = jax.jit(model.step)(parameters, history, commands[0])
    np.testing.assert_array_equal(after.motion[:-1], history.motion[1:])
    np.testing.assert_array_equal(after.commands[:-1], history.commands[1:])
    np.testing.assert_array_equal(after.commands[-1], log.a[T])
    if model.specification.target == "dq":
        np.testing.assert_array_equal(after.motion[-1], after.q)
    else:
        np.testing.assert_allclose(
            after.q, log.q[T] + 0.05 * np.asarray(after.motion[-1]), rtol=0, atol=1e-15
        )


def test_each_step_sees_the_command_about_to_act_and_none_after(one_model, one_models_parameters, log):
    with jax.enable_x64(True):
        history, commands = history_and_commands(one_model, log)
        sensitivity = jax.jit(jax.jacobian(lambda c: rollout(one_model, one_models_parameters, history, c)))(
            commands
        )
    acts = np.any(np.abs(sensitivity) > 0, axis=(1, 3))  # (predicted step, command step)
    np.testing.assert_array_equal(acts, np.tri(H, dtype=bool))


def test_the_oldest_command_of_the_history_serves_the_policy_only(one_model, one_models_parameters, log):
    with jax.enable_x64(True):
        history, commands = history_and_commands(one_model, log)
        changed = history._replace(commands=history.commands.at[0].set(9.0))
        predict = jax.jit(partial(Dynamics.roll_out, one_model, one_models_parameters))
        np.testing.assert_array_equal(predict(changed, commands), predict(history, commands))
        assert not np.array_equal(one_model.features(changed), one_model.features(history))


def test_leading_batch_axes(one_model, one_models_parameters, log):
    one_models_parameters = jax.tree.map(jnp.float32, one_models_parameters)
    history, commands = jax.tree.map(jnp.float32, history_and_commands(one_model, log))
    single = jax.jit(partial(rollout, one_model, one_models_parameters))(history, commands)
    batch = jax.tree.map(lambda x: jnp.broadcast_to(x, (2, 3, *x.shape)), (history, commands))
    batched = jax.jit(partial(rollout, one_model, one_models_parameters))(*batch)
    assert batched.shape == (2, 3, H, 2)
    np.testing.assert_allclose(batched, np.broadcast_to(single, batched.shape), atol=1e-6)


def test_kan_layer_is_that_of_jaxkan():
    layer = LegendreLayer(6, 5, 4, seed=1)
    network = KolmogorovArnoldNetwork(6, [], 5, degree=4)
    parameters = {"layer_0": {"c_basis": layer.c_basis[...], "bias": layer.bias[...] + 0.3}}
    x = jax.random.normal(jax.random.key(0), (7, 6))
    np.testing.assert_allclose(apply(network, parameters, x), layer(x) + 0.3, atol=1e-5)


def test_kan_layers_of_equal_shape_start_unlike():
    model = DynamicsModel(make_specification("kan", "dq", hidden=(8, 8, 8)))
    parameters = model.initialise(jax.random.key(0))
    assert not np.array_equal(parameters["layer_1"]["c_basis"], parameters["layer_2"]["c_basis"])


def test_parameters_follow_the_key(model):
    first, again, other = (model.initialise(jax.random.key(seed)) for seed in (0, 0, 1))
    assert jax.tree.all(jax.tree.map(np.array_equal, first, again))
    assert not np.array_equal(jax.tree.leaves(first)[-1], jax.tree.leaves(other)[-1])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"hidden": ()}, "hidden"),
        ({"lags": -1}, "lags"),
    ],
)
def test_impossible_specifications_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        make_specification("mlp", "dq", **change)


def test_window_length_is_lags_plus_one():
    model = DynamicsModel(make_specification("mlp", "dqdot", lags=0))
    assert model.initial_history(jnp.zeros(2)).motion.shape == (1, 2)
    assert model.specification.n_features == 2 * 2 * 1 + 2
    assert LAGS > 0
