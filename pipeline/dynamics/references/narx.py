"""A polynomial NARX model whose terms are selected from the data: a reference for the learned models.

    motion[t+1] = Σ θ_i · x_i · x_i',   x, x' ∈ {1, motion[t−l], a[t−m], q[t]}

of all joints, for the lags l and m of two given sets. Every product of up to two variables is a candidate; FROLS
selects (`forward_regression`) and least squares fits. `motion` is the velocity estimate (dqdot) or the
displacement of the last step (dq), so that q[t+1] = q[t] + Δt · motion[t+1], or q[t] + motion[t+1].
(Billings, "Nonlinear System Identification", Wiley 2013; the same method as SysIdentPy's FROLS.)

Terms are selected by their one-step error, and a polynomial that predicts one step well may diverge in simulation.
So, among the numbers of terms that the information criterion allows, the one with the smallest simulation error on the
training rows is chosen (Piroddi, Spinelli, "An identification algorithm for
polynomial NARX models based on simulation error minimization", Int. J. Control 76(17), 2003).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.dynamics.evaluation.errors import open_loop_residuals
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.references.forward_regression import TermSelection, select_terms
from pipeline.dynamics.training.windows import window_starts
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory

CHUNK_ROWS = 2048  # rows whose candidates are in memory at once
TERM_NUMBER_FACTOR = 2  # factor between the tried numbers of terms


@dataclass
class NarxConfig:
    """Candidate terms and their number.

    Attributes:
        target: dq or dqdot: meaning of `motion`.
        motion_lags: l; zero is the newest.
        command_lags: m; zero is the command about to act.
        maximum_terms: Most terms per joint.
        maximum_rows: Most training rows for selection and fit; of more, every n-th is used.
        simulation_horizon: Steps of the simulations that determine the number of terms.
    """

    target: Target
    motion_lags: list[int]
    command_lags: list[int]
    maximum_terms: int
    maximum_rows: int
    simulation_horizon: int

    def __post_init__(self) -> None:
        for name in ("motion_lags", "command_lags"):
            lags = getattr(self, name)
            if isinstance(lags, str):
                return  # OmegaConf builds the node first and the object later
            if not lags or min(lags) < 0 or len(set(lags)) != len(lags):
                raise InputError(f"judge.narx.{name} is {lags}; list different lags that are not negative")
        for name in ("maximum_terms", "maximum_rows", "simulation_horizon"):
            if getattr(self, name) < 1:
                raise InputError(f"judge.narx.{name} is {getattr(self, name)}; it must be at least 1")


@dataclass(frozen=True)
class NarxPredictor:
    """A fitted NARX model.

    Attributes:
        config: Lags and target.
        dt_s: Length of one time step.
        first: (n_terms,) index of each term's first variable in `_variables`, over all joints' terms.
        second: (n_terms,) index of its second variable; variable 0 is the constant 1.
        coefficients: (n_terms, n_joint); zero if a joint has not selected the term.
        error_reduction_ratios: (n_terms, n_joint); zero likewise.
    """

    config: NarxConfig
    dt_s: float
    first: np.ndarray
    second: np.ndarray
    coefficients: np.ndarray
    error_reduction_ratios: np.ndarray

    @property
    def rows_before(self) -> int:
        """The longest lag; a displacement needs one more row."""
        return _rows_before(self.config)

    def predict(self, trajectory: Trajectory, starts: np.ndarray, horizon: int) -> np.ndarray:
        """See `errors.Predictor.predict`. Predictions of a diverging polynomial are infinite or NaN."""
        config = self.config
        motion = _motion(trajectory, config.target)[starts[:, None] + np.arange(-max(config.motion_lags), 1)]
        commands = trajectory.a[starts[:, None] + np.arange(-max(config.command_lags), horizon)]
        newest_command = max(config.command_lags)
        q = np.asarray(trajectory.q[starts], np.float64)
        scale = 1.0 if config.target is Target.dq else self.dt_s
        predictions = np.empty((len(starts), horizon, q.shape[-1]))
        with np.errstate(over="ignore", invalid="ignore"):
            for step in range(horizon):
                x = _variables(
                    [motion[:, -1 - lag] for lag in config.motion_lags],
                    [commands[:, newest_command + step - lag] for lag in config.command_lags],
                    q,
                )
                newest = (x[:, self.first] * x[:, self.second]) @ self.coefficients
                q = q + scale * newest
                motion = np.concatenate([motion[:, 1:], newest[:, None]], axis=1)
                predictions[:, step] = q
        return predictions

    def term_names(self, joint_names: Sequence[str]) -> list[str]:
        """The terms as formulas, such as `v_boom[t] a_arm[t-3]`."""
        names = variable_names(self.config, joint_names)
        return [
            names[j] if i == 0 else f"{names[i]} {names[j]}"
            for i, j in zip(self.first.tolist(), self.second.tolist(), strict=True)
        ]


def fit_narx(trajectories: Sequence[Trajectory], config: NarxConfig, dt_s: float) -> NarxPredictor:
    """Select and fit the terms of every joint on the training rows, one step ahead.

    Args:
        trajectories: Rows with their split; only training rows are used.
        config: Candidates and limits.
        dt_s: Length of one time step.

    Raises:
        InputError: if no trajectory has enough consecutive training rows for the longest lag, or a lag exceeds the
            history before the first judged row.
    """
    x, y = _rows(trajectories, config)
    first, second = np.triu_indices(x.shape[1])  # every pair of variables once; (0, 0) is the constant
    n_joint = y.shape[1]
    gram = np.zeros((len(first), len(first)))
    correlation = np.zeros((len(first), n_joint))
    for start in range(0, len(x), CHUNK_ROWS):
        part = x[start : start + CHUNK_ROWS]
        candidates = part[:, first] * part[:, second]
        gram += candidates.T @ candidates
        correlation += candidates.T @ y[start : start + CHUNK_ROWS]
    selections = [
        select_terms(
            gram, correlation[:, joint], float(y[:, joint] @ y[:, joint]), len(x), config.maximum_terms
        )
        for joint in range(n_joint)
    ]
    best, smallest = None, np.inf
    n_terms = max(len(selection.terms) for selection in selections)
    while best is None or n_terms >= 1:
        kept = [selection.first(n_terms) for selection in selections]
        predictor = _fitted(x, y, first, second, kept, config, dt_s)
        error = _simulation_error(predictor, trajectories)
        if best is None or error < smallest:
            best, smallest = predictor, error
        n_terms //= TERM_NUMBER_FACTOR
    return best


def variable_names(config: NarxConfig, joint_names: Sequence[str]) -> list[str]:
    """Names of the variables in their order: `v` is a velocity estimate, `d` the last step's displacement."""
    symbol = "d" if config.target is Target.dq else "v"

    def at(lag: int) -> str:
        return f"[t-{lag}]" if lag else "[t]"

    return [
        "1",
        *(f"{symbol}_{joint}{at(lag)}" for lag in config.motion_lags for joint in joint_names),
        *(f"a_{joint}{at(lag)}" for lag in config.command_lags for joint in joint_names),
        *(f"q_{joint}[t]" for joint in joint_names),
    ]


def _fitted(
    x: np.ndarray,
    y: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
    selections: Sequence[TermSelection],
    config: NarxConfig,
    dt_s: float,
) -> NarxPredictor:
    used = np.unique(np.concatenate([selection.terms for selection in selections]))
    coefficients, ratios = np.zeros((2, len(used), len(selections)))
    for joint, selection in enumerate(selections):
        regressors = x[:, first[selection.terms]] * x[:, second[selection.terms]]
        place = np.searchsorted(used, selection.terms)
        coefficients[place, joint] = np.linalg.lstsq(regressors, y[:, joint])[0]
        ratios[place, joint] = selection.error_reduction_ratios
    return NarxPredictor(config, dt_s, first[used], second[used], coefficients, ratios)


def _simulation_error(predictor: NarxPredictor, trajectories: Sequence[Trajectory]) -> float:
    """Squared error of simulations of the training rows, relative to each joint's squared displacement."""
    horizon = predictor.config.simulation_horizon
    error, motion = np.zeros((2, predictor.coefficients.shape[1]))
    for trajectory in trajectories:
        starts = window_starts(
            [trajectory], validation=False, first_row=predictor.rows_before, horizon=horizon
        )
        starts = starts[::horizon]
        residuals = open_loop_residuals(predictor, trajectory, starts, horizon)
        error += np.sum(residuals**2, axis=(0, 1))
        rows = starts[:, None] + 1 + np.arange(horizon)
        motion += np.sum((trajectory.q[rows] - trajectory.q[starts][:, None]) ** 2, axis=(0, 1))
    return float(np.sum(error / np.where(motion > 0, motion, 1.0)))


def _rows(trajectories: Sequence[Trajectory], config: NarxConfig) -> tuple[np.ndarray, np.ndarray]:
    """Variables (N, n_variables) and the next motion (N, n_joint), of training rows."""
    before = _rows_before(config)
    ends_of = []
    for trajectory in trajectories:
        training = ~trajectory.is_validation
        ends = np.arange(before, len(trajectory) - 1)
        ends_of.append(ends[training[ends] & training[ends + 1]])
    n_rows = sum(len(ends) for ends in ends_of)
    if n_rows == 0:
        raise InputError(f"judge: no trajectory has {before + 2} training rows in a row; give longer logs")
    stride = -(-n_rows // config.maximum_rows)
    inputs, outputs = [], []
    for trajectory, all_ends in zip(trajectories, ends_of, strict=True):
        ends, motion = all_ends[::stride], _motion(trajectory, config.target)
        inputs.append(
            _variables(
                [motion[ends - lag] for lag in config.motion_lags],
                [trajectory.a[ends - lag] for lag in config.command_lags],
                trajectory.q[ends],
            )
        )
        outputs.append(motion[ends + 1])
    return np.concatenate(inputs), np.concatenate(outputs)


def _variables(motion: Sequence[np.ndarray], commands: Sequence[np.ndarray], q: np.ndarray) -> np.ndarray:
    return np.concatenate([np.ones((len(q), 1)), *motion, *commands, q], axis=1)


def _motion(trajectory: Trajectory, target: Target) -> np.ndarray:
    if target is Target.dqdot:
        return trajectory.qd
    return np.diff(trajectory.q, axis=0, prepend=trajectory.q[:1])


def _rows_before(config: NarxConfig) -> int:
    return max(max(config.motion_lags) + (1 if config.target is Target.dq else 0), *config.command_lags)
