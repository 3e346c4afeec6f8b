"""The compiled epoch: data stay on the device, and every window is used."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from pipeline.dynamics.training.epoch import compile_epoch, compile_evaluation
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
