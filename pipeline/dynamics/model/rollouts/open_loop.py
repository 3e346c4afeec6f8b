"""Open-loop rollouts: logged commands in, predicted configurations out.

`Dynamics.roll_out` is the definition, `rollout` the same at less cost, for training and evaluation, where
all commands are known beforehand: rows are normalised and expanded once, not once per window that they lie
in; windows of commands are cut from one buffer; and commands and motion enter the first layer apart, so
that back-propagation carries no gradient to the commands unless it is asked for.

Its gradient is written down, too (`_scan_backward`). Back-propagation through time needs, step by step, only
what comes back at each layer's output; the kernels' gradients are then one large matrix product per layer
over all windows and steps, instead of a small one, and a sum over it, per step.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from pipeline.dynamics.model.features import History
from pipeline.dynamics.model.network import Layer, Parameters
from pipeline.dynamics.model.stepwise_model import StepwiseModel
from pipeline.dynamics.model.stops import Stops

Arrays = list[jax.Array]


def rollout(
    model: StepwiseModel,
    parameters: Parameters,
    history: History,
    commands: jax.Array,
    stops: Stops | None = None,
) -> jax.Array:
    """Predict in open loop; arguments and result as of `Dynamics.roll_out`, equal up to rounding.

    Reverse-mode derivatives only, as of any function with a gradient of its own; with stops, none.
    """
    layers = model.network.layers(parameters)
    if stops is None:
        q = _scan(model, layers, history, commands)
    else:
        q, _ = _scan_with_inputs(model, layers, history, commands, None, stops)
    return jnp.moveaxis(q, 0, -2)


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _scan(model: StepwiseModel, layers: list[Layer], history: History, commands: jax.Array) -> jax.Array:
    """The rollout with steps in front: (H, ..., n_joint)."""
    q, _ = _scan_with_inputs(model, layers, history, commands, outputs=None)
    return q


def _scan_forward(
    model: StepwiseModel, layers: list[Layer], history: History, commands: jax.Array
) -> tuple[jax.Array, Any]:
    steps_and_batch = (commands.shape[-2], *commands.shape[:-2])
    dtype = jnp.result_type(history.q, layers[0].kernel)
    outputs = [jnp.zeros((*steps_and_batch, len(layer.bias)), dtype) for layer in layers]
    q, pull, inputs = jax.vjp(
        lambda history, commands, outputs: _scan_with_inputs(model, layers, history, commands, outputs),
        history,
        commands,
        outputs,
        has_aux=True,
    )
    return q, (pull, inputs)


def _scan_backward(model: StepwiseModel, residuals: Any, cotangent: jax.Array) -> tuple:
    pull, ((commands, motion), *inputs) = residuals
    from_history, from_commands, (first, *others) = pull(cotangent)
    window = commands.shape[-1]
    by_motion = _kernel_gradient(motion, first)
    by_commands = _kernel_gradient(commands, first)
    kernels = [jnp.concatenate([by_motion[:window], by_commands, by_motion[window:]])]
    kernels += [_kernel_gradient(*pair) for pair in zip(inputs, others, strict=True)]
    biases = [output.reshape(-1, output.shape[-1]).sum(axis=0) for output in (first, *others)]
    return [Layer(*pair) for pair in zip(kernels, biases, strict=True)], from_history, from_commands


_scan.defvjp(_scan_forward, _scan_backward)


def _scan_with_inputs(
    model: StepwiseModel,
    layers: list[Layer],
    history: History,
    commands: jax.Array,
    outputs: Arrays | None,
    stops: Stops | None = None,
) -> tuple[jax.Array, list]:
    """Configurations, and what each layer's gradient needs, all with steps in front.

    Args:
        model: The dynamics model.
        layers: Of its network.
        history: Before the first command.
        commands: (..., H, n_joint).
        outputs: Per layer (H, ..., width), of any value: their cotangents will be those of the layer's output.
            None, if no gradient is wanted.
        stops: Where joints end; None: they do not.

    Returns:
        (H, ..., n_joint), and, if a gradient is wanted, per layer its input (H, ..., ·): for the first the
        commands and the rest of x̃, for the others the output of the layer before; all expanded.
    """
    network = model.network
    row = commands.shape[-1] * network.expansion  # expanded values per row
    window = row * (model.specification.lags + 1)
    first, *others = layers
    command_kernel = first.kernel[window : 2 * window]
    motion_kernel = jnp.concatenate([first.kernel[:window], first.kernel[2 * window :]])

    # The window of step j holds commands j … j+k of this buffer; the oldest command is in no window any more.
    known = network.expand(_flat(jnp.concatenate([history.commands[..., 1:, :], commands], axis=-2)))

    def advance(carry: tuple, step: tuple) -> tuple[tuple, tuple]:
        motion, newest, q = carry  # motion: expanded and normalised rows of the window
        index, outputs = step
        acting = jax.lax.dynamic_slice_in_dim(known, index * row, window, axis=-1)
        moving = jnp.concatenate([motion, network.expand(model.normalise_position(q))], axis=-1)
        y = acting @ command_kernel + moving @ motion_kernel + first.bias

        def of_output(number: int, y: jax.Array) -> jax.Array:
            return y if outputs is None else _with_cotangent_of(y, outputs[number])

        q, newest, inputs = model.finish_step(others, y, q, newest, stops, of_output)
        appended = network.expand(model.normalise_motion(newest))
        carry = (jnp.concatenate([motion[..., row:], appended], axis=-1), newest, q)
        return carry, (q, None if outputs is None else [(acting, moving), *inputs])

    motion = network.expand(_flat(model.normalise_motion(history.motion)))
    initial = (motion, history.motion[..., -1, :], history.q)
    _, (q, inputs) = jax.lax.scan(advance, initial, (jnp.arange(commands.shape[-2]), outputs))
    return q, inputs


@jax.custom_vjp
def _with_cotangent_of(value: jax.Array, other: jax.Array) -> jax.Array:
    """`value`, whose cotangent becomes that of `other`, too."""
    return value


_with_cotangent_of.defvjp(lambda value, other: (value, None), lambda _, cotangent: (cotangent, cotangent))


def _kernel_gradient(inputs: jax.Array, outputs: jax.Array) -> jax.Array:
    """Σ over all leading axes of the outer products: (..., n_in), (..., n_out) -> (n_in, n_out)."""
    inputs, outputs = (array.reshape(-1, array.shape[-1]) for array in (inputs, outputs))
    if inputs.shape[-1] <= outputs.shape[-1]:
        return inputs.T @ outputs
    # XLA's matrix product on CPUs is twice as fast with the narrower operand in front. The barrier keeps the
    # compiler from turning it round again.
    return jax.lax.optimization_barrier(outputs.T @ inputs).T


def _flat(rows: jax.Array) -> jax.Array:
    """(..., T, n_joint) to (..., T * n_joint), time-major."""
    return rows.reshape(*rows.shape[:-2], -1)
