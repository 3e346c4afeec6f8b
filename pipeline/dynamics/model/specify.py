"""A model's specification from its configuration, the machine, and the training rows' scales."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from pipeline.dynamics.model.dynamics_model import ModelSpecification, Target
from pipeline.dynamics.model.fir.specification import FirSpecification
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.model.shown_motion import Shown
from pipeline.dynamics.settings import IdentifyConfig, TrainingConfig
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import CommandKind, MachineSpecification

LIMITS_APART = 0.1  # of a joint's range: by more, limits are those of another machine


class Scales(NamedTuple):
    """What of a specification follows from training rows, each (n_joint,).

    Attributes:
        velocity_limit: As of `ModelSpecification`.
        residual_scale: As of `ModelSpecification`.
        stop_lower: Of a kind `nfir`, infinite where there is none.
        stop_upper: Of a kind `nfir`, infinite where there is none.
    """

    velocity_limit: np.ndarray
    residual_scale: np.ndarray
    stop_lower: np.ndarray
    stop_upper: np.ndarray


def specify(
    trajectories: Sequence[Trajectory],
    machine: MachineSpecification,
    parameterization: Parameterization,
    target: Target,
    training: TrainingConfig,
    identify: IdentifyConfig,
) -> ModelSpecification:
    """The model's specification, with its scales taken from the training rows.

    Raises:
        InputError: A joint never moves, or the settings are not of this kind.
    """
    limits = velocity_limits(trajectories, machine.joint_names, identify.velocity_limit_quantile)
    if parameterization is Parameterization.nfir:
        shown = Shown.of(trajectories, machine.dt_s)
        speed = shown.usual_speed()
        scales = Scales(limits, speed, *shown.stops(machine.lower, machine.upper, speed))
    else:
        scales = Scales(limits, residual_scales(trajectories, target), machine.lower, machine.upper)
    return specification_of(scales, machine, parameterization, target, training, identify.legendre_degree)


def specification_of(
    scales: Scales,
    machine: MachineSpecification,
    parameterization: Parameterization,
    target: Target,
    training: TrainingConfig,
    legendre_degree: int,
) -> ModelSpecification:
    """The specification of a model with these scales.

    Raises:
        InputError: The settings are not of this kind.
    """
    ensemble = training.ensemble
    if (parameterization is Parameterization.nfir) != (ensemble is not None):
        raise InputError(
            f"identify: {parameterization}_{target} has {'an' if ensemble else 'no'} ensemble; a kind nfir, and no "
            "other, needs one"
        )
    common: dict[str, Any] = {
        "parameterization": parameterization,
        "target": target,
        "hidden": list(training.hidden),
        "lags": training.lags,
        "legendre_degree": legendre_degree,
        "joints": list(machine.joint_names),
        "rate_hz": machine.rate_hz,
        "position_lower": machine.lower.tolist(),
        "position_upper": machine.upper.tolist(),
        "velocity_limit": scales.velocity_limit.tolist(),
        "residual_scale": scales.residual_scale.tolist(),
    }
    if ensemble is None:
        return ModelSpecification(**common)
    if training.horizon != 1:
        raise InputError(
            f"identify: horizon is {training.horizon}; a kind nfir is trained on single steps: 1"
        )
    is_switched = machine.command_kind is CommandKind.discrete
    return FirSpecification(
        **common,
        members=ensemble.members,
        member_hidden=list(ensemble.hidden),
        demand_beyond=list(range(1, machine.n_joint - 1)) if is_switched else [],
        stop_lower=[float(stop) if np.isfinite(stop) else None for stop in scales.stop_lower],
        stop_upper=[float(stop) if np.isfinite(stop) else None for stop in scales.stop_upper],
    )


def check_machine(specification: ModelSpecification, machine: MachineSpecification, name: str) -> None:
    """Raise `InputError` if a model is of another machine: of other joints, limits or another rate.

    Names do not tell machines apart: all excavators have a boom. Limits that were corrected a little do not make
    another machine: the model keeps those that it was trained with.

    Args:
        specification: The model's.
        machine: What it is to be used for.
        name: Of the model, for the message.
    """
    lower, upper = np.array(specification.position_lower), np.array(specification.position_upper)
    is_same = list(specification.joints) == list(machine.joint_names) and np.isclose(
        specification.rate_hz, machine.rate_hz
    )
    if is_same:
        apart = np.abs(np.stack([lower - machine.lower, upper - machine.upper]))
        is_same = np.all(apart <= LIMITS_APART * (machine.upper - machine.lower))
    if not is_same:
        own = _described(specification.joints, lower, upper, specification.rate_hz)
        expected = _described(machine.joint_names, machine.lower, machine.upper, machine.rate_hz)
        raise InputError(
            f"{name}: the model is of joints {own}, machine {machine.name} has {expected}; give the model's "
            "machine=NAME, or identify again if the machine was changed"
        )


def _described(joints: Sequence[str], lower: Iterable[float], upper: Iterable[float], rate_hz: float) -> str:
    limits = [
        f"{joint} [{low:.6g}, {high:.6g}]" for joint, low, high in zip(joints, lower, upper, strict=True)
    ]
    return f"{', '.join(limits)} at {rate_hz:.6g} Hz"


def velocity_limits(trajectories: Sequence[Trajectory], joints: Sequence[str], quantile: float) -> np.ndarray:
    """Velocity limits for the min-max normalisation: ± the given quantile of |q̇| over the training rows.

    Symmetric, so that rest is zero; a quantile, so that a single outlier of the estimate does not set the
    scale.

    Returns:
        (n_joint,) float64, rad/s or m/s.

    Raises:
        InputError: if there are no training rows, or a joint never moves in them.
    """
    speeds = np.abs(np.concatenate([trajectory.qd[~trajectory.is_validation] for trajectory in trajectories]))
    if len(speeds) == 0:
        raise InputError("identify: no row of the tuples has split train; ingest the logs again")
    limits = np.quantile(speeds.astype(np.float64), quantile, axis=0)
    for joint, limit in zip(joints, limits, strict=True):
        if not limit > 0:
            raise InputError(
                f"identify: joint {joint} never moves in the training rows; add logs in which it does"
            )
    return limits


def residual_scales(trajectories: Sequence[Trajectory], target: Target) -> np.ndarray:
    """RMS of the residual that the network predicts, over the training rows: (n_joint,) float64."""
    name = "q" if target is Target.dq else "qd"
    residuals = [
        np.diff(getattr(trajectory, name)[~trajectory.is_validation], axis=0) for trajectory in trajectories
    ]
    return np.sqrt(np.mean(np.concatenate(residuals) ** 2, axis=0))
