"""The compiled epoch: data stay on the device, and every window is used."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from pipeline.dynamics.model.fir.model import MEMBERS
from pipeline.dynamics.training.epoch import clip_each_network, compile_epoch, compile_evaluation
from pipeline.dynamics.training.loss import prediction_loss
from pipeline.dynamics.training.windows import stack_rows
from tests.dynamics.conftest import random_trajectory


@pytest.fixture(scope="module")
def epoch(one_model):
    """One epoch of four batches of eight windows, and its arguments."""
    optimiser = optax.sgd(0.0)
    run = compile_epoch(
        one_model, optimiser, prediction_loss(one_model, np.ones(2)), horizon=3, batch_size=8, n_batches=4
    )
    parameters = one_model.initialise(jax.random.key(0))
    rows = stack_rows([random_trajectory(0, n_rows=60)])
    return run, (parameters, optimiser.init(parameters), rows, jnp.arange(10, 42), jax.random.key(1))


def test_nothing_passes_between_host_and_device_within_an_epoch(epoch, one_model):
    run, arguments = epoch
    evaluate = compile_evaluation(one_model, np.ones(2), horizon=3)
    run(*arguments), evaluate(arguments[0], *arguments[2:4])  # compilation places its constants
    with jax.transfer_guard("disallow"):
        after = run(*arguments)
        evaluate(after[0], *arguments[2:4])
        with pytest.raises(Exception, match="Disallowed host-to-device transfer"):
            run(*arguments[:3], np.arange(10, 42), arguments[4])
    primitives = {equation.primitive.name for equation in equations(jax.make_jaxpr(run)(*arguments).jaxpr)}
    assert "scan" in primitives  # the walk went into the loops
    assert not {name for name in primitives if "callback" in name or name in ("infeed", "outfeed")}


def equations(jaxpr):
    """Those of a jaxpr and of all jaxprs within."""
    for equation in jaxpr.eqns:
        yield equation
        for inner in jax.core.jaxprs_in_params(equation.params):
            yield from equations(inner)


def test_an_epoch_visits_every_window_once_whatever_the_order(epoch, one_model):
    """With steps of size zero the mean over the batches is the loss over all windows."""
    run, (parameters, state, rows, starts, _) = epoch
    whole = compile_evaluation(one_model, np.ones(2), horizon=3)(parameters, rows, starts)
    for seed in (1, 2):
        *_, loss = run(parameters, state, rows, starts, jax.random.key(seed))
        np.testing.assert_allclose(loss, whole, rtol=1e-5)


@pytest.mark.parametrize(
    "members", [{}, {MEMBERS: {"layer_0": {"kernel": jnp.array([[3.0, 4.0], [0.6, 0.8]])}}}]
)
def test_no_network_of_an_ensemble_is_clipped_for_another(members):
    clip = clip_each_network(2.0)
    own = {"layer_0": {"kernel": jnp.array([0.0, 8.0])}, "layer_1": {"kernel": jnp.array([6.0])}}
    clipped, _ = clip.update(own | members, clip.init(own | members))
    np.testing.assert_allclose(clipped["layer_0"]["kernel"], [0.0, 1.6], rtol=1e-6)
    np.testing.assert_allclose(clipped["layer_1"]["kernel"], [1.2], rtol=1e-6)
    if members:
        np.testing.assert_allclose(clipped[MEMBERS]["layer_0"]["kernel"], [[1.2, 1.6], [0.6, 0.8]], rtol=1e-6)
