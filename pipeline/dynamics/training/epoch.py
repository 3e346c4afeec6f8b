"""The compiled parts of training: an epoch of updates, and the evaluation loss L|eval."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import optax

from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.fir.model import MEMBERS
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.settings import IdentifyConfig, Optimiser, TrainingConfig
from pipeline.dynamics.training.loss import Loss, open_loop_loss
from pipeline.dynamics.training.windows import TrainingRows, gather_windows


def build_optimiser(
    training: TrainingConfig, identify: IdentifyConfig, n_batches: int
) -> optax.GradientTransformation:
    """Adam, with the configured clipping and decay; of an ensemble AdamW, whose rate decays always."""
    rate: optax.ScalarOrSchedule = training.learning_rate
    if identify.cosine_decay or training.ensemble is not None:
        rate = optax.cosine_decay_schedule(
            training.learning_rate, decay_steps=training.maximum_epochs * n_batches
        )
    steps = {Optimiser.adam: optax.adam}[identify.optimiser](rate)
    if training.ensemble is not None:
        steps = optax.adamw(rate, weight_decay=training.ensemble.weight_decay, mask=_members_only)
    if identify.gradient_clip is None:
        return steps
    return optax.chain(clip_each_network(identify.gradient_clip), steps)


def clip_each_network(largest_norm: float) -> optax.GradientTransformation:
    """Clip f's gradient and each member's by a norm of its own, so that none is shortened for another."""
    clip = optax.clip_by_global_norm(largest_norm)

    def clipped(gradient: Parameters) -> Parameters:
        return clip.update(gradient, clip.init(gradient))[0]

    def update(gradient: Parameters, _: Parameters | None) -> Parameters:
        f = clipped({name: of for name, of in gradient.items() if name != MEMBERS})
        return f | {name: jax.vmap(clipped)(of) for name, of in gradient.items() if name == MEMBERS}

    return optax.stateless(update)


def _members_only(parameters: Parameters) -> dict[str, bool]:
    return {name: name == MEMBERS for name in parameters}


def compile_epoch(
    model: DynamicsModel,
    optimiser: optax.GradientTransformation,
    loss_of: Loss,
    horizon: int,
    batch_size: int,
    n_batches: int,
) -> Callable[..., tuple[Parameters, optax.OptState, jax.Array]]:
    """One epoch as one call: (parameters, optimiser state, rows, starts, key) -> (…, …, mean loss)."""

    @jax.jit
    def run_epoch(
        parameters: Parameters,
        optimiser_state: optax.OptState,
        rows: TrainingRows,
        starts: jax.Array,
        key: jax.Array,
    ) -> tuple[Parameters, optax.OptState, jax.Array]:
        order = jax.random.permutation(key, starts)[: n_batches * batch_size].reshape(n_batches, batch_size)

        def update(
            carry: tuple[Parameters, optax.OptState], batch: jax.Array
        ) -> tuple[tuple[Parameters, optax.OptState], jax.Array]:
            parameters, optimiser_state = carry
            window = gather_windows(model, rows, batch, horizon)
            loss, gradient = jax.value_and_grad(loss_of)(parameters, window, batch)
            updates, optimiser_state = optimiser.update(gradient, optimiser_state, parameters)
            return (optax.apply_updates(parameters, updates), optimiser_state), loss

        (parameters, optimiser_state), losses = jax.lax.scan(update, (parameters, optimiser_state), order)
        return parameters, optimiser_state, jnp.mean(losses)

    return run_epoch


def compile_evaluation(
    model: DynamicsModel, error_scale: np.ndarray, horizon: int
) -> Callable[[Parameters, TrainingRows, jax.Array], jax.Array]:
    """L|eval as one compiled call: (parameters, rows, starts) -> scalar."""

    @jax.jit
    def evaluate(parameters: Parameters, rows: TrainingRows, starts: jax.Array) -> jax.Array:
        window = gather_windows(model, rows, starts, horizon)
        return open_loop_loss(model, parameters, *window, jnp.asarray(error_scale))

    return evaluate
