"""Back-propagation through time that goes on on measured rows: what both trained baselines share.

The named effects are compared with a fine-tuned network and with a black-box residual network. Both get the
same rows, the same learning rates to choose from, and the same gradient steps: they call one function.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax

from pipeline.discrepancy.unusable_logs import UnusableLogs
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.training.epoch import compile_epoch, compile_evaluation
from pipeline.dynamics.training.fit import TrainingState, after_epoch, initial_state
from pipeline.dynamics.training.loss import prediction_loss
from pipeline.dynamics.training.windows import FIRST_JUDGED_ROW, stack_rows, window_starts
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification


@dataclass
class BaselinesConfig:
    """Section `close_loop.baselines_budget` of a profile: the tuning budget that both baselines get.

    Attributes:
        learning_rates: Candidates; the loss on the selection rows chooses among them.
        horizon: H of the training loss.
        batch_size: Windows per gradient step.
        batches_per_epoch: Gradient steps between two evaluations.
        maximum_epochs: The learning rate falls to zero over these as a half cosine.
        patience_evaluations: Early stopping: evaluations (one per epoch) in a row without improvement.
        gradient_clip: Largest global norm of the gradient; null: no clipping.
        evaluation_horizon: H of the loss on the selection rows.
        evaluation_windows: At most this many windows, evenly among those that the selection rows hold.
    """

    learning_rates: list[float]
    horizon: int
    batch_size: int
    batches_per_epoch: int
    maximum_epochs: int
    patience_evaluations: int
    gradient_clip: float | None
    evaluation_horizon: int
    evaluation_windows: int

    def __post_init__(self) -> None:
        place = "close_loop.baselines_budget"
        if isinstance(self.learning_rates, str):
            return  # OmegaConf builds the node first and the object later
        if not self.learning_rates or not min(self.learning_rates) > 0:
            raise InputError(
                f"{place}.learning_rates is {list(self.learning_rates)}; list at least one, all positive"
            )
        for name in (
            "horizon",
            "batch_size",
            "batches_per_epoch",
            "maximum_epochs",
            "patience_evaluations",
            "evaluation_horizon",
            "evaluation_windows",
        ):
            if getattr(self, name) < 1:
                raise InputError(f"{place}.{name} is {getattr(self, name)}; it must be at least 1")
        if self.gradient_clip is not None and not self.gradient_clip > 0:
            raise InputError(f"{place}.gradient_clip is {self.gradient_clip}; it must be positive, or null")


def continue_training(
    model: DynamicsModel,
    parameters: Parameters,
    trajectories: Sequence[Trajectory],
    machine: MachineSpecification,
    settings: BaselinesConfig,
    seed: int,
) -> Parameters:
    """Train from given parameters on, once per learning rate, and keep the best by the selection rows.

    Args:
        model: Its normalisation is kept: nothing of the specification follows the measured rows.
        parameters: Where every candidate starts. They are a candidate themselves: no training that makes the
            selection rows worse is kept.
        trajectories: Measured rows; `is_validation` marks those that select, the others are fitted.
        machine: The scale of errors.
        settings: The budget.
        seed: Order of the windows, the same for every learning rate.

    Returns:
        The parameters with the smallest loss on the selection rows, over all epochs of all candidates.

    Raises:
        UnusableLogs: if the rows of either kind are too short for one window.
    """
    starts = window_starts(trajectories, False, model.specification.lags + 1, settings.horizon)
    judged = window_starts(trajectories, True, FIRST_JUDGED_ROW, settings.evaluation_horizon)
    for kind, found, horizon in (
        ("fit", starts, settings.horizon),
        ("select", judged, settings.evaluation_horizon),
    ):
        if len(found) == 0:
            raise UnusableLogs(
                "measured",
                f"no trajectory has {horizon + 1} rows in a row to {kind} the baselines on, after "
                f"{FIRST_JUDGED_ROW} rows of history; give longer measured logs",
            )
    n_judged = min(len(judged), settings.evaluation_windows)
    selecting = judged[np.linspace(0, len(judged) - 1, n_judged).round().astype(int)]
    rows = stack_rows(trajectories)
    batch_size = min(settings.batch_size, len(starts))
    n_batches = min(settings.batches_per_epoch, len(starts) // batch_size)
    optimiser = _optimiser(settings, n_batches)
    loss_of = prediction_loss(model, machine.error_scale)
    run_epoch = compile_epoch(model, optimiser, loss_of, settings.horizon, batch_size, n_batches)
    evaluate = compile_evaluation(model, machine.error_scale, settings.evaluation_horizon)
    device_starts, device_selecting = jnp.asarray(starts), jnp.asarray(selecting)
    best, best_loss = parameters, float(evaluate(parameters, rows, device_selecting))
    for rate in settings.learning_rates:
        state = initial_state(parameters, optimiser, settings.maximum_epochs)
        state = state._replace(optimiser_state=_with_rate(state.optimiser_state, rate))
        while not _ended(state, settings):
            key = jax.random.fold_in(jax.random.key(seed), state.epoch)
            moved, optimiser_state, loss = run_epoch(
                state.parameters, state.optimiser_state, rows, device_starts, key
            )
            state = after_epoch(state, moved, optimiser_state, loss, evaluate(moved, rows, device_selecting))
        # A loss that is no number, of the model itself or of a candidate, loses against any number.
        if float(state.best_loss) < np.nan_to_num(best_loss, nan=np.inf):
            best, best_loss = state.best_parameters, float(state.best_loss)
    return best


def _optimiser(settings: BaselinesConfig, n_batches: int) -> optax.GradientTransformation:
    """Adam whose learning rate is part of its state, so that all candidates share one compilation."""
    decay = optax.cosine_decay_schedule(1.0, decay_steps=settings.maximum_epochs * n_batches)
    clip = (
        optax.identity()
        if settings.gradient_clip is None
        else optax.clip_by_global_norm(settings.gradient_clip)
    )

    def with_rate(learning_rate: float) -> optax.GradientTransformation:
        return optax.chain(
            clip, optax.scale_by_adam(), optax.scale_by_schedule(decay), optax.scale(-learning_rate)
        )

    return optax.inject_hyperparams(with_rate)(learning_rate=settings.learning_rates[0])


def _with_rate(optimiser_state: Any, rate: float) -> Any:
    return optimiser_state._replace(hyperparams={"learning_rate": jnp.asarray(rate, jnp.float32)})


def _ended(state: TrainingState, settings: BaselinesConfig) -> bool:
    epoch, best_epoch = int(state.epoch), int(state.best_epoch)
    return epoch >= settings.maximum_epochs or epoch - best_epoch >= settings.patience_evaluations
