"""Identification: minimisation of the H-step loss by back-propagation through time (paper, "Training details").

An epoch visits every training window once in shuffled order (or `batches_per_epoch` batches of them, drawn
afresh each epoch), and runs as one compiled call; rows stay on the device. After each epoch L|eval is
computed on the fixed evaluation windows; the best parameters by L|eval are kept, and training ends when it
has not fallen for `patience_evaluations` evaluations.
"""

import hashlib
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from pipeline.dynamics.model.dynamics_model import DynamicsModel, Target
from pipeline.dynamics.model.fir.model import FirModel
from pipeline.dynamics.model.kinds import build_model
from pipeline.dynamics.model.network import Parameterization, Parameters
from pipeline.dynamics.model.specify import specify
from pipeline.dynamics.settings import IdentifyConfig, TrainingConfig
from pipeline.dynamics.training.checkpoint import Checkpoints
from pipeline.dynamics.training.ensemble_loss import ensemble_loss, part_bounds
from pipeline.dynamics.training.epoch import build_optimiser, compile_epoch, compile_evaluation
from pipeline.dynamics.training.loss import prediction_loss
from pipeline.dynamics.training.windows import evaluation_starts, stack_rows, window_starts
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification


class TrainingDivergedError(InputError):
    """L|eval was never finite, which is due to the hyper-parameters."""


class TrainingState(NamedTuple):
    """State of a training between epochs, which is the content of a checkpoint."""

    epoch: jax.Array  # epochs done
    parameters: Parameters
    optimiser_state: optax.OptState
    best_parameters: Parameters
    best_loss: jax.Array  # smallest L|eval so far
    best_epoch: jax.Array
    training_loss: jax.Array  # (maximum_epochs,), mean over the epoch's batches; NaN for later epochs
    evaluation_loss: jax.Array  # (maximum_epochs,), L|eval after the epoch; NaN for later epochs


@dataclass(frozen=True)
class FitResult:
    """Result of identification.

    Attributes:
        model: The dynamics model.
        parameters: Parameters with the smallest L|eval; of a kind `nfir` the last ones.
        curves: Columns `epoch`, `training_loss`, `evaluation_loss`, one value per epoch.
        metrics: Flat figures: `evaluation_loss` (of the parameters), `best_epoch`, `epochs`, `n_parameters`,
            `training_windows`.
    """

    model: DynamicsModel
    parameters: Parameters
    curves: dict[str, list[float]]
    metrics: dict[str, float]


Progress = Callable[[int, float, float], None]  # epoch, training loss, L|eval


def fit(
    trajectories: Sequence[Trajectory],
    machine: MachineSpecification,
    parameterization: Parameterization,
    target: Target,
    training: TrainingConfig,
    identify: IdentifyConfig,
    seed: int,
    progress: Progress | None = None,
    checkpoint_directory: Path | None = None,
) -> FitResult:
    """Identify a dynamics model from logged rows.

    Args:
        trajectories: Rows with their split into training and validation (L|eval, early stopping).
        machine: Joints, limits, rate, and the scale of errors.
        parameterization: mlp or kan.
        target: dq or dqdot.
        training: Size of the network, lags, horizon, batch size, learning rate, epochs.
        identify: Common settings of all trainings.
        seed: Initial parameters and the order of the windows. The evaluation windows follow `identify.seed`.
        progress: Called after each epoch with (epoch from 1, mean training loss, L|eval).
        checkpoint_directory: Folder of the state for resuming, or None. A killed run that is restarted with the same
            arguments gives the result of an uninterrupted run.

    Raises:
        InputError: if the rows are too short, or a joint never moves.
        TrainingDivergedError: if L|eval is never finite.
    """
    starts = window_starts(
        trajectories, validation=False, first_row=training.lags + 1, horizon=training.horizon
    )
    if len(starts) == 0:
        raise InputError(
            f"identify: no trajectory has {training.lags + 1 + training.horizon + 1} training rows in a row, "
            f"which lags {training.lags} and horizon {training.horizon} need; record longer or lower them"
        )
    model = build_model(specify(trajectories, machine, parameterization, target, training, identify))
    judged = evaluation_starts(
        trajectories, identify.evaluation_horizon, identify.evaluation_windows, identify.seed
    )
    rows = stack_rows(trajectories)
    batch_size = min(training.batch_size, len(starts))
    n_batches = len(starts) // batch_size
    if identify.batches_per_epoch is not None:
        n_batches = min(n_batches, identify.batches_per_epoch)
    initial_key, order_key = jax.random.split(jax.random.key(seed))
    optimiser = build_optimiser(training, identify, n_batches)
    loss_of = prediction_loss(model, machine.error_scale)
    if isinstance(model, FirModel):
        loss_of = ensemble_loss(model, part_bounds(starts, model.specification.members))
    run_epoch = compile_epoch(model, optimiser, loss_of, training.horizon, batch_size, n_batches)
    evaluate = compile_evaluation(model, machine.error_scale, identify.evaluation_horizon)
    state = initial_state(model.initialise(initial_key), optimiser, training.maximum_epochs)
    identity = (
        f"{seed} {model.specification} {machine.error_scale} {training} {identify} {_digest(trajectories)}"
    )
    device_starts, device_judged = jnp.asarray(starts), jnp.asarray(judged)
    with closing(Checkpoints[TrainingState](checkpoint_directory, identity)) as checkpoints:
        state = checkpoints.restore(state)
        while not _ended(state, training, identify):
            key = jax.random.fold_in(order_key, state.epoch)
            parameters, optimiser_state, loss = run_epoch(
                state.parameters, state.optimiser_state, rows, device_starts, key
            )
            evaluation_loss = evaluate(parameters, rows, device_judged)
            state = after_epoch(state, parameters, optimiser_state, loss, evaluation_loss)
            epoch = int(state.epoch)
            if progress is not None:
                progress(epoch, float(loss), float(evaluation_loss))
            if epoch % identify.checkpoint_every_epochs == 0 or _ended(state, training, identify):
                checkpoints.save(epoch, state)
    state = _last_as_best(state) if isinstance(model, FirModel) else state
    return _result(model, state, n_windows=len(starts))


def initial_state(
    parameters: Parameters, optimiser: optax.GradientTransformation, maximum_epochs: int
) -> TrainingState:
    """State before the first epoch."""
    return TrainingState(
        epoch=jnp.zeros((), jnp.int32),
        parameters=parameters,
        optimiser_state=optimiser.init(parameters),
        best_parameters=parameters,
        best_loss=jnp.full((), jnp.inf, jnp.float32),
        best_epoch=jnp.zeros((), jnp.int32),
        training_loss=jnp.full((maximum_epochs,), jnp.nan, jnp.float32),
        evaluation_loss=jnp.full((maximum_epochs,), jnp.nan, jnp.float32),
    )


@jax.jit
def after_epoch(
    state: TrainingState,
    parameters: Parameters,
    optimiser_state: optax.OptState,
    training_loss: jax.Array,
    evaluation_loss: jax.Array,
) -> TrainingState:
    """Update the curves and the best parameters at the end of an epoch."""
    better = evaluation_loss < state.best_loss
    return TrainingState(
        epoch=state.epoch + 1,
        parameters=parameters,
        optimiser_state=optimiser_state,
        best_parameters=jax.tree.map(
            lambda new, old: jnp.where(better, new, old), parameters, state.best_parameters
        ),
        best_loss=jnp.where(better, evaluation_loss, state.best_loss),
        best_epoch=jnp.where(better, state.epoch + 1, state.best_epoch),
        training_loss=state.training_loss.at[state.epoch].set(training_loss),
        evaluation_loss=state.evaluation_loss.at[state.epoch].set(evaluation_loss),
    )


def _ended(state: TrainingState, training: TrainingConfig, identify: IdentifyConfig) -> bool:
    epoch, best_epoch = int(state.epoch), int(state.best_epoch)
    has_waited = training.ensemble is None and epoch - best_epoch >= identify.patience_evaluations
    return epoch >= training.maximum_epochs or has_waited


def _digest(trajectories: Sequence[Trajectory]) -> str:
    digest = hashlib.sha256()
    for trajectory in trajectories:
        for array in (trajectory.q, trajectory.qd, trajectory.a, trajectory.is_validation):
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _last_as_best(state: TrainingState) -> TrainingState:
    """An ensemble ends with steps that have decayed to nothing: its last parameters are less noisy than any before."""
    loss = state.evaluation_loss[state.epoch - 1]
    return state._replace(best_parameters=state.parameters, best_loss=loss, best_epoch=state.epoch)


def _result(model: DynamicsModel, state: TrainingState, n_windows: int) -> FitResult:
    if not np.isfinite(float(state.best_loss)):
        raise TrainingDivergedError(
            "identify: L|eval was never finite; lower the learning rate or set identify.gradient_clip"
        )
    epochs = int(state.epoch)
    return FitResult(
        model=model,
        parameters=state.best_parameters,
        curves={
            "epoch": [float(epoch) for epoch in range(1, epochs + 1)],
            "training_loss": np.asarray(state.training_loss[:epochs], np.float64).tolist(),
            "evaluation_loss": np.asarray(state.evaluation_loss[:epochs], np.float64).tolist(),
        },
        metrics={
            "evaluation_loss": float(state.best_loss),
            "best_epoch": float(state.best_epoch),
            "epochs": float(epochs),
            "n_parameters": float(sum(leaf.size for leaf in jax.tree.leaves(state.best_parameters))),
            "training_windows": float(n_windows),
        },
    )
