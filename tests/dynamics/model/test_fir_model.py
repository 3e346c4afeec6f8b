"""The nonlinear finite-impulse-response model against its equation in float64 NumPy, and what follows from it."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.dynamics.model.dynamics import Dynamics
from pipeline.dynamics.model.fir.model import FirModel
from pipeline.dynamics.model.fir.specification import FirSpecification
from pipeline.dynamics.model.stops import Stops
from pipeline.dynamics.model.store import load_model, save_model
from pipeline.errors import InputError
from tests.dynamics.conftest import make_specification, move_biases

LAGS, N_JOINT, DT_S, H = 4, 3, 0.05, 9
LOWER, UPPER = np.array([-1.0, 0.05, -2.0]), np.array([0.5, 0.3, 1.0])
SPEED = np.array([0.6, 0.1, 0.9])
STRETCHES = [[0], [1, 2], [3], [4]]  # of the window's five rows


def specification(**changes) -> FirSpecification:
    values = vars(make_specification("mlp", "dqdot", lags=LAGS, hidden=(6, 5))) | {
        "parameterization": "nfir",
        "joints": ["turn", "slide", "lift"],
        "position_lower": LOWER.tolist(),
        "position_upper": UPPER.tolist(),
        "velocity_limit": [0.7, 0.1, 1.0],
        "residual_scale": SPEED.tolist(),
        "members": 3,
        "member_hidden": [4],
        "demand_beyond": [1],
        "stop_lower": [-0.98, None, -2.0],
        "stop_upper": [0.5, 0.3, None],
    }
    return FirSpecification(**(values | changes))


@pytest.fixture(scope="module")
def model() -> FirModel:
    return FirModel(specification())


@pytest.fixture(scope="module")
def parameters(model):
    return move_biases(model.initialise(jax.random.key(0)))


def velocity(layers: list, commands: np.ndarray, q: np.ndarray) -> np.ndarray:
    """f of the window a_{t-k} … a_t (k+1, n_joint) and q_t, as written in the docs."""
    excess = np.maximum(np.abs(commands).sum(axis=1) - 1.0, 0.0)
    place = 2.0 * (q - LOWER) / (UPPER - LOWER) - 1.0
    x = np.concatenate([commands.ravel(), [excess[stretch].mean() for stretch in STRETCHES], place])
    for number, layer in enumerate(layers):
        x = x if number == 0 else x / (1.0 + np.exp(-x))
        x = x @ layer["kernel"] + layer["bias"]
    return SPEED * x


def reference(parameters, before: np.ndarray, commands: np.ndarray, q: np.ndarray) -> np.ndarray:
    """(H, n_joint): q after each command, from the k commands before."""
    layers = [parameters[f"layer_{index}"] for index in range(3)]
    known, visited = np.concatenate([before, commands]), []
    lower, upper = np.array([-0.98, -np.inf, -2.0]), np.array([0.5, 0.3, np.inf])
    for step in range(len(commands)):
        moved = q + DT_S * velocity(layers, known[step : step + LAGS + 1], q)
        q = np.clip(moved, np.minimum(lower, q), np.maximum(upper, q))
        visited.append(q)
    return np.array(visited)


def start(model, seed=1):
    random = np.random.default_rng(seed)
    q, qd, a = (random.uniform(-1, 1, (LAGS + 2, N_JOINT)) for _ in range(3))
    q[-1] = [0.497, 0.2, 0.99]  # next to a stop, inside, next to a limit without one
    history = model.history_from_rows(*(jnp.asarray(array) for array in (q, qd, a)))
    commands = jnp.asarray(random.uniform(-1, 1, (H, N_JOINT)))
    return history, commands, a[1:-1]


@pytest.mark.parametrize("predict", [Dynamics.roll_out, FirModel.roll_out], ids=["steps", "fast"])
def test_rollout_is_the_equation(model, parameters, predict):
    with jax.enable_x64(True):
        history, commands, before = start(model)
        predicted = jax.jit(partial(predict, model))(parameters, history, commands)
    expected = reference(parameters, before, np.asarray(commands), np.asarray(history.q))
    np.testing.assert_allclose(predicted, expected, rtol=0, atol=1e-13)
    assert np.any(expected[:, 0] == 0.5)  # the stop is met


def test_held_commands_are_steps(model, parameters):
    parameters = jax.tree.map(jnp.float32, parameters)
    stops = Stops(LOWER.astype(np.float32), UPPER.astype(np.float32))
    history = jax.tree.map(jnp.float32, start(model)[0])
    commands = jnp.sign(jax.random.normal(jax.random.key(3), (6, 4, N_JOINT)))
    expected = Dynamics.held_rollout(model, parameters, 3, stops)(history, commands)
    found = jax.jit(model.held_rollout(parameters, 3, stops))(history, commands)
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6)
    hold, step = (
        jax.jit(partial(way, model, parameters, n_steps=3, stops=stops))
        for way in (FirModel.hold, Dynamics.hold)
    )
    held = single = model.initial_history(history.q)
    for command in commands[0]:
        (held, q), (single, expected) = hold(held, command), step(single, command)
        np.testing.assert_allclose(q, expected, rtol=0, atol=2e-6)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=0, atol=1e-5), held, single)


def test_the_gradient_is_that_of_finite_differences(model, parameters):
    with jax.enable_x64(True):
        history, commands, _ = start(model)
        history = history._replace(q=jnp.asarray([-0.2, 0.2, 0.1]))

        def loss(parameters):
            return jnp.sum(model.roll_out(parameters, history, commands) ** 2)

        gradient = jax.jit(jax.grad(loss))(parameters)
        for name in ("layer_0", "layer_1"):
            at = np.zeros_like(parameters[name]["kernel"])
            at[2, 1] = 1e-6
            moved = [
                loss(
                    parameters | {name: parameters[name] | {"kernel": parameters[name]["kernel"] + sign * at}}
                )
                for sign in (1.0, -1.0)
            ]
            assert gradient[name]["kernel"][2, 1] == pytest.approx(
                float(moved[0] - moved[1]) / 2e-6, rel=1e-6
            )


def test_no_history_drives_it_away(parameters):
    """Measured velocities of any size change nothing, and the velocity stays below what the kernels allow."""
    model = FirModel(specification(stop_lower=LOWER.tolist(), stop_upper=UPPER.tolist()))
    with jax.enable_x64(True):
        history, _, _ = start(model)
        wild = history._replace(motion=1e9 * jnp.ones_like(history.motion))
        commands = jnp.asarray(np.random.default_rng(0).uniform(-1, 1, (2000, N_JOINT)))
        predict = jax.jit(model.roll_out)
        visited = np.asarray(predict(parameters, history, commands))
        np.testing.assert_array_equal(predict(parameters, wild, commands), visited)
    bound = np.concatenate([np.ones(N_JOINT * (LAGS + 1)), 2.0 * np.ones(len(STRETCHES)), np.ones(N_JOINT)])
    for index in range(3):
        layer = parameters[f"layer_{index}"]
        bound = bound @ np.abs(layer["kernel"]) + np.abs(layer["bias"])  # |silu(x)| <= |x|
    assert np.all(np.abs(np.diff(visited, axis=0)) / DT_S <= SPEED * bound)
    assert np.all((visited >= LOWER) & (visited <= UPPER))


def test_a_saved_model_predicts_as_before(model, parameters, tmp_path):
    parameters = jax.tree.map(np.float32, parameters)
    save_model(tmp_path / "model", model, parameters, {}, {}, {})
    loaded, restored = load_model(tmp_path / "model")
    assert isinstance(loaded, FirModel)
    assert loaded.specification == model.specification
    history, commands, _ = start(model)
    np.testing.assert_array_equal(
        loaded.roll_out(restored, history, commands), model.roll_out(parameters, history, commands)
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"target": "dq"}, "target dqdot"),
        ({"members": 1}, "members is 1"),
        ({"stop_upper": [None]}, "stop_upper has 1 values for 3 joints"),
    ],
)
def test_impossible_specifications_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        specification(**change)
