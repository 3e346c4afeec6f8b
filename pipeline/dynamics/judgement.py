"""Judgement of models and references on rows that neither training nor selection used."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.dynamics.evaluation.error_growth import ErrorGrowth, ErrorGrowthConfig, error_growth
from pipeline.dynamics.evaluation.errors import PredictionErrors, Predictor, prediction_errors
from pipeline.dynamics.evaluation.extrapolation import (
    Extrapolation,
    ExtrapolationConfig,
    extrapolate,
    largest_speed,
)
from pipeline.dynamics.references.all_references import ArxConfig
from pipeline.dynamics.references.grey_box import GreyBoxConfig
from pipeline.dynamics.references.narx import NarxConfig
from pipeline.dynamics.training.windows import FIRST_JUDGED_ROW
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification

KNOWN_SHARE = 0.1  # share of known rows above which a recording counts as known


@dataclass
class JudgeConfig:
    """Section `judge` of a profile.

    Attributes:
        long_prediction_steps: Length of the open-loop prediction that is plotted.
        arx: The linear references.
        narx: The polynomial reference.
        grey_box: The physical reference.
        growth: How error growth is measured.
        extrapolation: Rollouts outside the training distribution.
    """

    long_prediction_steps: int
    arx: ArxConfig
    narx: NarxConfig
    grey_box: GreyBoxConfig
    growth: ErrorGrowthConfig
    extrapolation: ExtrapolationConfig

    def __post_init__(self) -> None:
        if self.long_prediction_steps < 1:
            raise InputError(
                f"judge.long_prediction_steps is {self.long_prediction_steps}; it must be at least 1"
            )


@dataclass(frozen=True)
class OpenLoopPrediction:
    """One long open-loop prediction (paper, Fig. "Open-loop predictions").

    Attributes:
        trajectory: Name of the trajectory.
        t_s: Times of the predicted rows, s from the bag's start, shape (H,).
        measured: Positions, rad or m, shape (H, n_joint).
        predicted: Positions predicted from the row before the first, shape (H, n_joint).
        commands: Commands in force up to each of these rows, shape (H, n_joint).
    """

    trajectory: str
    t_s: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    commands: np.ndarray


@dataclass(frozen=True)
class ModelJudgement:
    """All measurements of one predictor."""

    errors: PredictionErrors
    growth: ErrorGrowth
    extrapolation: Extrapolation
    open_loop: OpenLoopPrediction


def judge_fully(
    predictors: Mapping[str, Predictor],
    learning: Sequence[Trajectory],
    held_out: Sequence[Trajectory],
    machine: MachineSpecification,
    config: JudgeConfig,
    progress: Callable[[str], None] = lambda name: None,
) -> dict[str, ModelJudgement]:
    """Judge several predictors on the same rows, windows and rollouts.

    Args:
        predictors: Predictors by name.
        learning: Training data, which give the largest speed in training.
        held_out: Test data.
        machine: Limits and rate.
        config: Horizons and numbers.
        progress: Called with each finished name.

    Raises:
        InputError: if the held-out recording is too short.
    """
    speed = largest_speed(learning, machine.dt_s)
    judgements = {}
    for name, predictor in predictors.items():
        judgements[name] = ModelJudgement(
            prediction_errors(predictor, held_out),
            error_growth(predictor, held_out, config.growth),
            extrapolate(predictor, machine, speed, config.extrapolation),
            long_prediction(predictor, held_out, FIRST_JUDGED_ROW, config.long_prediction_steps),
        )
        progress(name)
    return judgements


def flat_metrics(judgements: Mapping[str, ModelJudgement], machine: MachineSpecification) -> dict[str, float]:
    """All figures as `<predictor>.<quantity>.<joint>`, without those that could not be measured."""
    metrics: dict[str, float] = {}
    for name, judgement in judgements.items():
        growth = judgement.growth
        quantities = {
            "one_step_rmse": judgement.errors.one_step_rmse,
            "open_loop_rmse_80": judgement.errors.open_loop_rmse_80,
            f"rmse_after_{len(growth.rmse)}_steps": growth.rmse[-1],
            f"rmse_after_{len(growth.rmse)}_steps_lower": growth.lower[-1],
            f"rmse_after_{len(growth.rmse)}_steps_upper": growth.upper[-1],
            **vars(judgement.extrapolation),
        }
        metrics |= {
            f"{name}.{quantity}.{joint}": float(value)
            for quantity, values in quantities.items()
            for joint, value in zip(machine.joint_names, values, strict=True)
            if np.isfinite(value)
        }
        metrics |= {"n_windows": judgement.errors.n_windows, "n_steps": judgement.errors.n_steps}
    return metrics


def check_unseen(learning: Sequence[Trajectory], held_out: Sequence[Trajectory]) -> None:
    """Raise InputError if a held-out trajectory holds training rows, whatever its name."""
    again = seen_again(learning, held_out)
    if again is not None:
        raise InputError(
            f"held_out: trajectory {again.name} was learned from; give a recording that neither training "
            "nor selection saw"
        )


def seen_again(known: Sequence[Trajectory], others: Sequence[Trajectory]) -> Trajectory | None:
    """The first of `others` that holds rows of `known`, whatever its name; None if all are new.

    Rows are equal if their times and positions are. All tables may begin at time zero from one rest position, so a few
    equal rows are allowed.
    """
    first = _first_holders([*known, *others])[len(known) :]
    seen = (other for other, of in zip(others, first, strict=True) if np.mean(of < len(known)) > KNOWN_SHARE)
    return next(seen, None)


def seen_twice(trajectories: Sequence[Trajectory]) -> Trajectory | None:
    """The first that holds rows of one before it, as in `seen_again`; None if each is new."""
    first = enumerate(_first_holders(trajectories))
    return next((trajectories[place] for place, of in first if np.mean(of < place) > KNOWN_SHARE), None)


def _first_holders(trajectories: Sequence[Trajectory]) -> list[np.ndarray]:
    """Per trajectory (T,) which one holds an equal row first."""
    if not trajectories:
        return []
    lengths = list(map(len, trajectories))
    rows = np.concatenate(
        [np.column_stack([t.stamp_ns, np.ascontiguousarray(t.q).view(np.int64)]) for t in trajectories]
    )
    _, first, row = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    holder = np.repeat(np.arange(len(trajectories)), lengths)[first[row.ravel()]]
    return np.split(holder, np.cumsum(lengths)[:-1])


def judge(
    predictors: Mapping[str, Predictor], trajectories: Sequence[Trajectory], machine: MachineSpecification
) -> dict[str, object]:
    """Errors of several predictors on the same rows (contract, section 3).

    Returns:
        By predictor `one_step_rmse` and `open_loop_rmse_80` by joint (rad or m), and once `n_windows` and `n_steps`.
    """
    metrics: dict[str, object] = {}
    for name, predictor in predictors.items():
        errors = prediction_errors(predictor, trajectories)
        metrics[name] = {
            "one_step_rmse": dict(zip(machine.joint_names, errors.one_step_rmse.tolist(), strict=True)),
            "open_loop_rmse_80": dict(
                zip(machine.joint_names, errors.open_loop_rmse_80.tolist(), strict=True)
            ),
        }
        metrics |= {"n_windows": errors.n_windows, "n_steps": errors.n_steps}
    return metrics


def long_prediction(
    predictor: Predictor, trajectories: Sequence[Trajectory], first_row: int, horizon: int
) -> OpenLoopPrediction:
    """Predict `horizon` steps of the longest trajectory in open loop, from `first_row` on; fewer if it is shorter."""
    trajectory = max(trajectories, key=len)
    horizon = min(horizon, len(trajectory) - first_row - 1)
    rows = slice(first_row + 1, first_row + 1 + horizon)
    predicted = predictor.predict(trajectory, np.array([first_row]), horizon)[0]
    return OpenLoopPrediction(
        trajectory.name,
        trajectory.t_s[rows],
        trajectory.q[rows],
        predicted,
        trajectory.a[first_row : first_row + horizon],
    )
