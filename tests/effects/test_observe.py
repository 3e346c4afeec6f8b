"""A history that follows what is measured, row by row, against the predictor, which sees the whole log at once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.effects.augmented_model import WARM_S, AugmentedModel, AugmentedParameters
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.chain import Chain
from pipeline.effects.predictor import AugmentedPredictor

from .conftest import DT_S, LOWER, SETTING, UPPER, VALUES, WRAPPED, make_model, make_trajectory, rows

START, HORIZON = 40, 20


def log_of(seed, n_rows=START + HORIZON + 1):
    """Positions that velocities lead to, from the middle on."""
    u, signals = rows(seed, n_rows)
    q = 0.5 * (LOWER + UPPER) + 0.3 * DT_S * np.cumsum(u, axis=0)
    return make_trajectory(q, np.gradient(q, DT_S, axis=0), signals.command, start_s=WARM_S)


@pytest.mark.parametrize("target", ["dq", "dqdot"])
@pytest.mark.parametrize("family", WRAPPED)
def test_what_is_predicted_after_measured_rows_is_what_the_predictor_says(family, target):
    frozen = make_model("mlp", target)
    theta, log = frozen.initialise(jax.random.key(1)), log_of(3)
    chain, values = Chain([KNOWN[family]], SETTING), {family: VALUES[family]}
    parameters = AugmentedParameters(
        theta, jax.tree.map(lambda value: jnp.asarray(value, jnp.float32), values)
    )
    model = AugmentedModel(frozen, chain)
    q, qd, a = (jnp.asarray(column, jnp.float32) for column in (log.q, log.qd, log.a))

    @jax.jit
    def predicted():
        first = model.at_rest(parameters, q[0])
        first = first._replace(time_s=first.time_s - DT_S)  # the log's first row is its first measured step
        before = jnp.concatenate([jnp.zeros_like(a[:1]), a[:START]])

        def observe(history, row):
            return model.observe(parameters, history, *row), None

        history, _ = jax.lax.scan(observe, first, (q[: START + 1], qd[: START + 1], before))
        return model.roll_out(parameters, history, a[START : START + HORIZON])

    expected = AugmentedPredictor(frozen, theta, chain, values, has_stops=False)
    expected = expected.predict(log, np.array([START]), HORIZON)[0]
    assert np.abs(expected - log.q[START]).max() > 3e-3
    np.testing.assert_allclose(predicted(), expected, atol=2e-5)


def test_at_rest_an_encoder_s_reading_is_the_one_that_was_given():
    frozen, chain = make_model(), Chain([KNOWN["sensor_bias"]], SETTING)
    theta = jax.tree.map(jnp.zeros_like, frozen.initialise(jax.random.key(0)))  # stays where it is
    model, parameters = (
        AugmentedModel(frozen, chain),
        AugmentedParameters(theta, {"sensor_bias": VALUES["sensor_bias"]}),
    )
    q = jnp.array([-0.2, 0.2])
    after = model.step(parameters, model.at_rest(parameters, q), jnp.zeros(2))
    np.testing.assert_allclose(after.q, q, atol=1e-6)


def test_histories_with_values_of_their_own_step_as_models_with_those_values():
    frozen, families = make_model(), ["delay", "flow_coupling", "lag", "sensor_bias"]
    chain, theta = Chain([KNOWN[f] for f in families], SETTING), frozen.initialise(jax.random.key(1))
    model = AugmentedModel(frozen, chain)
    drawn = [
        jax.tree.map(
            lambda v, by=by: jnp.asarray(by * v, jnp.float32), {f: dict(VALUES[f]) for f in families}
        )
        for by in (0.9, 1.05, 1.0)
    ]
    a = jnp.asarray(rows(5, 15, (3,))[1].command)
    q = jnp.tile(jnp.array([-0.2, 0.2]), (3, 1))

    def after(values, q, a):
        parameters = AugmentedParameters(theta, values)
        return model.roll_out(parameters, model.at_rest(parameters, q), a)

    alone = jnp.stack([after(values, q[n], a[:, n]) for n, values in enumerate(drawn)])
    stacked = jax.tree.map(lambda *of: jnp.stack(of), *drawn)
    parameters = AugmentedParameters(theta, stacked)
    of_all = model.at_rest(parameters, q)._replace(values=stacked)
    others = AugmentedParameters(theta, jax.tree.map(jnp.zeros_like, drawn[0]))  # which they override
    together = model.roll_out(others, of_all, jnp.moveaxis(a, 1, 0))
    assert np.abs(alone[0] - alone[1]).max() > 1e-3
    np.testing.assert_allclose(together, alone, atol=1e-6)
