"""The gradient against finite differences, and the forward pass against the environment."""

import dataclasses
from functools import partial

import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.control.apg.config import APGConfig
from pipeline.control.apg.network import as_policy, error_inputs, initial_layers
from pipeline.control.apg.rollout import Between, discounted_cost, straight_through, with_gradient_between
from pipeline.dynamics.model.features import History
from pipeline.effects.augmented_model import AugmentedHistory
from pipeline.machine.specification import CommandKind
from pipeline.machine.workspace import contains, depths
from pipeline.reaching.task import ReachingTask
from tests.reaching.lag import lag_dynamics

N, DECISIONS, REPEATS = 3, 3, 4


@pytest.fixture(scope="module")
def config() -> APGConfig:
    smoke = load_section("apg", APGConfig, "smoke")
    return dataclasses.replace(smoke, horizon=DECISIONS, environments=N, hidden=[8], feedback=1.0)


def episodes(environment):
    keys = jax.random.split(jax.random.key(1), N)
    return jax.vmap(lambda key: environment.new_episode(key).task)(keys)


def layers_of(task):
    first, last = initial_layers(jax.random.key(2), task.observation_size, [8], 4)
    return first, last._replace(kernel=10.0 * last.kernel)  # commands of every sign from the start


def test_a_discrete_command_is_exact_and_has_the_gradient_of_the_smooth_step():
    proto = jnp.linspace(-1.0, 1.0, 41)
    command = straight_through(CommandKind.discrete, proto, 4.0)
    np.testing.assert_array_equal(command, np.where(np.abs(proto) > 0.5, np.sign(proto), 0.0))
    slope = jax.vmap(jax.grad(lambda p: straight_through(CommandKind.discrete, p, 4.0)))(proto)
    by_hand = sum(2.0 / np.cosh(4.0 * (np.asarray(proto) + side)) ** 2 for side in (-0.5, 0.5))
    np.testing.assert_allclose(slope, by_hand, rtol=1e-5)


def test_gradients_between_two_commands_average_to_what_the_switch_does():
    """Of a joint with a dead band, which is flat at both commands: it moves when its last two commands add up to 1."""
    n = 2001

    def hold(history, command):
        moved = jax.nn.sigmoid(20.0 * (history.commands[:, -1] + command - 1.0))
        return history._replace(q=history.q + moved), moved

    rest = History(jnp.zeros((n, 1, 1)), jnp.zeros((n, 1, 1)), jnp.zeros((n, 1)))
    between = Between(jnp.linspace(0.0, 1.0, n)[:, None], jnp.ones((n, 1)))

    def displacement(before, command):
        return with_gradient_between(hold, between)(rest._replace(commands=before[:, None]), command)[0].q

    zero = jnp.zeros((n, 1))
    np.testing.assert_array_equal(displacement(zero, zero), hold(rest, zero)[1])
    of_both = jax.grad(lambda before, command: displacement(before, command).sum(), (0, 1))(zero, zero)
    total = np.asarray(sum(of_both))[:, 0]
    switched = jax.nn.sigmoid(20.0) - jax.nn.sigmoid(-20.0)
    np.testing.assert_allclose(np.trapezoid(total, dx=1.0 / (n - 1)), switched, rtol=1e-3)
    assert total[0] < 1e-6  # exact commands alone


def test_the_window_that_effects_have_of_their_own_moves_as_well():
    window = History(jnp.zeros((2, 3, 1)), jnp.ones((2, 3, 1)), jnp.zeros((2, 1)))
    history = AugmentedHistory(*window, window, {}, jnp.zeros(2))
    between = Between(jnp.full((2, 1), 0.25), jnp.full((2, 1), -1.0))
    moved = between.of_history(history)
    np.testing.assert_array_equal(moved.commands, 0.5 * window.commands)
    np.testing.assert_array_equal(moved.nominal.commands, moved.commands)


def test_the_forward_pass_is_the_environments(environment, config):
    task = environment.task
    policy, before = as_policy(layers_of(task), error_inputs(task, config.error_gain)), episodes(environment)
    decide = jax.jit(partial(discounted_cost, config, task, REPEATS, policy))
    between = Between.draw(jax.random.key(6), N, 4)  # values are those of exact commands
    _, after = decide(before, jnp.zeros((DECISIONS, N, 4)), between)
    state = jax.jit(jax.vmap(environment.reset))(jax.random.split(jax.random.key(0), N))
    state = state.replace(pipeline_state=state.pipeline_state._replace(task=before), obs=task.observe(before))
    step = jax.jit(lambda state: environment.step(state, policy.act(state.obs)))
    for _ in range(DECISIONS):
        state = step(state)
    stepped = state.pipeline_state.task
    assert np.abs(after.command).max() == 1.0
    np.testing.assert_array_equal(after.command, stepped.command)
    np.testing.assert_allclose(after.history.q, stepped.history.q, atol=1e-6)


def test_the_gradient_is_that_of_finite_differences(environment, config):
    """Continuous commands, which are smooth within their limits."""
    bobcat = dataclasses.replace(environment.task.machine, command_kind=CommandKind.continuous)
    task = ReachingTask(bobcat, environment.task.arm, lag_dynamics(bobcat), {}, environment.task.reward)
    layers, inputs, before = layers_of(task), error_inputs(task, 1.0), episodes(environment)
    noise = 0.1 * jax.random.normal(jax.random.key(3), (DECISIONS, N, 4))
    smooth = dataclasses.replace(config, objective=dataclasses.replace(config.objective, edge_weight=0.0))

    @jax.jit
    def cost(layers):
        return discounted_cost(smooth, task, REPEATS, as_policy(layers, inputs), before, noise)[0]

    gradient, unravel = jax.grad(cost)(layers), jax.flatten_util.ravel_pytree(layers)[1]
    flat, flat_gradient = (jax.flatten_util.ravel_pytree(tree)[0] for tree in (layers, gradient))
    step = 2e-3  # float32: the truncation and the rounding of the difference are alike
    for direction in jax.random.normal(jax.random.key(0), (3, len(flat))):
        ahead, behind = (cost(unravel(flat + way)) for way in (step * direction, -step * direction))
        difference = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(flat_gradient @ direction, difference, rtol=0.02, atol=2e-3)


def test_without_feedback_the_state_has_no_gradient_through_the_policy(environment, config):
    task, before = environment.task, episodes(environment)
    policy = as_policy(layers_of(task), error_inputs(task, 1.0))

    def gradient(feedback):
        changed = dataclasses.replace(config, feedback=feedback, horizon=1)

        def command_after(q):
            shifted = before._replace(history=before.history._replace(q=q))
            return discounted_cost(changed, task, REPEATS, policy, shifted, jnp.zeros((1, N, 4)))[
                1
            ].command.sum()

        return jax.jit(jax.grad(command_after))(before.history.q)

    assert not np.any(gradient(0.0))
    assert np.any(gradient(1.0))


def test_inputs_of_the_first_layer_are_the_observation_with_differences_to_the_target(environment):
    task, state = environment.task, episodes(environment)
    inputs = np.asarray(task.observe(state) @ error_inputs(task, 5.0))
    x = task.dynamics.specification.n_features
    position = 5.0 * (state.goal.pose.position - state.pose.position)
    quaternion = 5.0 * (state.goal.pose.quaternion - state.pose.quaternion)
    now, target = map(task.dynamics.normalise_position, (state.history.q, state.goal.configuration))
    kept = np.asarray(task.observe(state))[:, : x + 7]
    expected = np.concatenate([kept, position, quaternion, now, 5.0 * (target - now)], axis=1)
    np.testing.assert_allclose(inputs, expected, atol=1e-5)


def test_depths_are_positive_inside_the_workspace_alone(bobcat, arm):
    unit = jax.random.uniform(jax.random.key(4), (2000, 4))
    q = jnp.asarray(bobcat.lower) + unit * (jnp.asarray(bobcat.upper) - jnp.asarray(bobcat.lower))
    position, yaw = arm.forward(q).position, arm.yaw(q)
    inside = np.stack(depths(bobcat.workspace, position, yaw)).min(axis=0) >= 0.0
    assert 0.1 < inside.mean() < 0.9
    np.testing.assert_array_equal(inside, contains(bobcat.workspace, position, yaw))
