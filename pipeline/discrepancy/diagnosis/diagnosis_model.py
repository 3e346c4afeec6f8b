"""The diagnosis model: the ensemble of a nonlinear finite-impulse-response model along whole logs.

A model that is fed measured velocities shows little of an effect in its one-step residual, because the effect is in
its input already. This one is driven by commands and positions alone, so that its residual shows all of it.

No member is trained on its own part of the nominal rows: what it is off there is the honest residual of a machine
without any effect.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.discrepancy.unusable_logs import UnusableLogs
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.fir.model import FirModel
from pipeline.dynamics.model.network import Parameterization, Parameters
from pipeline.dynamics.settings import IdentifyConfig, TrainingConfig
from pipeline.dynamics.training.ensemble_loss import part_bounds
from pipeline.dynamics.training.fit import fit
from pipeline.dynamics.training.windows import window_starts
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification

KIND = Parameterization.nfir, Target.dqdot


@dataclass(frozen=True)
class DiagnosisModel:
    """A trained model of the kind, and what its members did not see.

    Attributes:
        model: The model.
        parameters: Of f and of all members.
        left_out: Per member (B, T) bool: the nominal rows that it was not trained on.
    """

    model: FirModel
    parameters: Parameters
    left_out: np.ndarray

    def velocity(self, command: jax.Array, q: jax.Array) -> jax.Array:
        """Velocity by f before the stops, (..., T, n_joint), of commands and positions of that shape."""
        return self.model.velocity(self.parameters, self._inputs(command, q))

    def members_velocity(self, command: jax.Array, q: jax.Array) -> jax.Array:
        """Velocity by each member before the stops, (n_members, ..., T, n_joint)."""
        return self.model.members_velocity(self.parameters, self._inputs(command, q))

    def stopped(self, velocity: jax.Array, q: jax.Array) -> jax.Array:
        """The velocity, as far as the stops allow."""
        stops, dt_s = self.model.own_stops(q), self.model.specification.dt_s
        return (
            velocity
            if stops is None
            else jnp.clip(velocity, (stops.lower - q) / dt_s, (stops.upper - q) / dt_s)
        )

    def _inputs(self, command: jax.Array, q: jax.Array) -> jax.Array:
        command, q = jnp.asarray(command), jnp.asarray(q)
        lags, n_rows = self.model.specification.lags, command.shape[-2]
        known = jnp.pad(command, [(0, 0)] * (command.ndim - 2) + [(lags, 0), (0, 0)])
        windows = jnp.stack([known[..., lag : lag + n_rows, :] for lag in range(lags + 1)], axis=-2)
        return self.model.inputs(windows, q)


def training_of_diagnosis(identify: IdentifyConfig) -> TrainingConfig:
    """How the kind is trained, here as by `identify`."""
    return identify.training_of("_".join(KIND))


def train_diagnosis_model(
    nominal: Sequence[Trajectory],
    n_rows: int,
    machine: MachineSpecification,
    identify: IdentifyConfig,
    seed: int,
) -> DiagnosisModel:
    """Identify the kind from logs of the machine as it was.

    Args:
        n_rows: T, to which logs are padded.
        identify: Section `identify`.
        seed: Initial parameters and order of the windows.

    Raises:
        UnusableLogs: The logs are too short, or a joint never moves.
    """
    try:
        fitted = fit(nominal, machine, *KIND, training_of_diagnosis(identify), identify, seed)
    except InputError as error:
        raise UnusableLogs("nominal", str(error)) from error
    assert isinstance(fitted.model, FirModel)
    specification = fitted.model.specification
    left_out = left_out_rows(nominal, n_rows, specification.lags, specification.members)
    return DiagnosisModel(fitted.model, fitted.parameters, left_out)


def left_out_rows(nominal: Sequence[Trajectory], n_rows: int, lags: int, n_members: int) -> np.ndarray:
    """(n_members, B, n_rows) bool: the part that each member is not trained on; each row is in one of them.

    Rows that no member is trained on, for validation or without a history, go with those before.
    """
    bounds = part_bounds(window_starts(nominal, validation=False, first_row=lags + 1, horizon=1), n_members)
    lengths = np.array([len(trajectory) for trajectory in nominal])
    first = np.cumsum(lengths) - lengths
    rows = first[:, None] + np.minimum(np.arange(n_rows), lengths[:, None] - 1)
    return np.searchsorted(bounds, rows, side="right") == np.arange(n_members)[:, None, None]
