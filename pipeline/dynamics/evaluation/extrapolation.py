"""Behaviour outside the training distribution: constant commands from random configurations.

A policy exploits errors here: a joint that passes its limits, creeps without a command, does not stop, or exceeds the
machine's speed. Only predicted positions are measured, so that all predictors are treated equally. All rollouts start
from rest, with rows at rest as history.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.dynamics.evaluation.errors import Predictor, finite
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification

ROLLOUTS_AT_ONCE = 256  # per call of a predictor
SPEED_STEPS = 4  # steps per displacement of a speed, which averages noise
LIMIT_TOLERANCE = 0.01  # of a joint's range; a smaller excess is compliance or noise
UNBOUNDED_RANGES = 10.0  # in joint ranges; a rollout further from the middle counts as unbounded


@dataclass
class ExtrapolationConfig:
    """Settings of the rollouts.

    Attributes:
        seed: Seed of the configurations.
        configurations: Random configurations per pattern of commands.
        steps: Steps per rollout.
        motion_steps: For stopping: steps under command, after which all commands are zero.
        settle_steps: Steps of zero command after which the residual speed is measured.
        all_combinations_up_to_joints: Up to this number of joints, every combination of -1, 0 and 1 is a pattern;
            beyond it, each joint alone, and zero.
    """

    seed: int
    configurations: int
    steps: int
    motion_steps: int
    settle_steps: int
    all_combinations_up_to_joints: int

    def __post_init__(self) -> None:
        for name in ("configurations", "motion_steps"):
            if getattr(self, name) < 1:
                raise InputError(
                    f"judge.extrapolation.{name} is {getattr(self, name)}; it must be at least 1"
                )
        if self.settle_steps < SPEED_STEPS:
            raise InputError(
                f"judge.extrapolation.settle_steps is {self.settle_steps}; speeds are measured over "
                f"{SPEED_STEPS} steps, so give at least as many"
            )
        if self.steps < self.motion_steps + self.settle_steps:
            raise InputError(
                f"judge.extrapolation.steps is {self.steps}; motion_steps and settle_steps need "
                f"{self.motion_steps + self.settle_steps}"
            )
        for name in ("seed", "all_combinations_up_to_joints"):
            if getattr(self, name) < 0:
                raise InputError(
                    f"judge.extrapolation.{name} is {getattr(self, name)}; it must not be negative"
                )


@dataclass(frozen=True)
class Extrapolation:
    """Results of the rollouts by joint; all arrays (n_joint,).

    Attributes:
        left_limits: Share of the rollouts with the joint commanded in which it left its limits.
        beyond_median: Median excess over the limit in the same rollouts, rad or m.
        beyond_largest: Largest excess, rad or m.
        moved_uncommanded: Largest displacement while others were commanded and the joint was not, until the first
            joint left its limits, rad or m.
        drift_at_rest: Largest displacement from rest without any command, rad or m.
        residual_speed_median: Median speed after `settle_steps` of zero command after motion, rad/s or m/s.
        residual_speed_largest: Largest such speed, rad/s or m/s.
        creep_after_stop: Largest displacement from then until the end, rad or m.
        unbounded: Share of all rollouts that became infinite or left `UNBOUNDED_RANGES`.
        speed_ratio: Largest speed of all rollouts relative to the largest in the training rows.
        speed_ratio_inside: The same ratio until the first joint left its limits.
    """

    left_limits: np.ndarray
    beyond_median: np.ndarray
    beyond_largest: np.ndarray
    moved_uncommanded: np.ndarray
    drift_at_rest: np.ndarray
    residual_speed_median: np.ndarray
    residual_speed_largest: np.ndarray
    creep_after_stop: np.ndarray
    unbounded: np.ndarray
    speed_ratio: np.ndarray
    speed_ratio_inside: np.ndarray


def extrapolate(
    predictor: Predictor,
    machine: MachineSpecification,
    training_speed: np.ndarray,
    config: ExtrapolationConfig,
) -> Extrapolation:
    """Roll a predictor out under constant commands and measure its behaviour.

    Args:
        machine: Its limits and rate.
        training_speed: (n_joint,) largest speeds in the training rows, see `largest_speed`.
        config: Rollouts; equal seeds give equal rollouts for every predictor.
    """
    random = np.random.default_rng(config.seed)
    patterns = np.repeat(command_patterns(machine.n_joint, config), config.configurations, axis=0)
    starts = random.uniform(machine.lower, machine.upper, patterns.shape)
    held = _constant(patterns, config.steps)
    stopped = held.copy()
    stopped[:, config.motion_steps :] = 0.0
    moving = np.any(patterns != 0, axis=1)
    constant = simulate_from_rest(predictor, starts, held, machine.dt_s)
    stopping = simulate_from_rest(predictor, starts[moving], stopped[moving], machine.dt_s)

    commanded = patterns != 0
    middle, ranges = 0.5 * (machine.lower + machine.upper), machine.upper - machine.lower
    beyond = np.abs(constant - middle).max(axis=1) - 0.5 * ranges
    beyond = beyond.clip(min=0.0)
    inside = _inside(constant, machine)
    displacement = np.abs(constant - starts[:, None])
    settled = config.motion_steps + config.settle_steps - 1  # the row predicted by the last of these steps
    residual = np.abs(stopping[:, settled] - stopping[:, settled - SPEED_STEPS]) / (
        SPEED_STEPS * machine.dt_s
    )
    creep = np.abs(stopping[:, settled:] - stopping[:, settled : settled + 1]).max(axis=1)
    everything = np.concatenate([constant, stopping])
    unbounded = np.any(np.abs(everything - middle) >= UNBOUNDED_RANGES * ranges, axis=1)
    speed = _speeds(everything, machine.dt_s)
    speed_inside = np.where(_inside(everything, machine)[:, SPEED_STEPS:, None], speed, 0.0)
    training_speed = np.where(training_speed > 0, training_speed, np.nan)
    return Extrapolation(
        left_limits=_over(beyond > LIMIT_TOLERANCE * ranges, commanded, np.mean),
        beyond_median=_over(beyond, commanded, np.median),
        beyond_largest=_over(beyond, commanded, np.max),
        moved_uncommanded=_over(
            np.where(inside[..., None], displacement, 0.0).max(axis=1), ~commanded & moving[:, None], np.max
        ),
        drift_at_rest=displacement[~moving].max(axis=(0, 1)),
        residual_speed_median=_over(residual, commanded[moving], np.median),
        residual_speed_largest=_over(residual, commanded[moving], np.max),
        creep_after_stop=_over(creep, commanded[moving], np.max),
        unbounded=unbounded.mean(axis=0),
        speed_ratio=speed.max(axis=(0, 1)) / training_speed,
        speed_ratio_inside=speed_inside.max(axis=(0, 1)) / training_speed,
    )


def command_patterns(n_joint: int, config: ExtrapolationConfig) -> np.ndarray:
    """Constant commands, (n_patterns, n_joint); the zero pattern is one of them."""
    if n_joint <= config.all_combinations_up_to_joints:
        return np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=n_joint)))
    return np.concatenate([-np.eye(n_joint), np.eye(n_joint), np.zeros((1, n_joint))])


def simulate_from_rest(
    predictor: Predictor, starts: np.ndarray, commands: np.ndarray, dt_s: float
) -> np.ndarray:
    """Predict from rest at given configurations.

    Args:
        starts: (R, n_joint) configurations, rad or m.
        commands: (R, H, n_joint).
        dt_s: Length of one time step.

    Returns:
        (R, H, n_joint) float64, finite (see `errors.DIVERGED`).
    """
    before, (_, horizon, n_joint) = predictor.rows_before, commands.shape
    length = before + 1 + horizon  # rows of one rollout: at rest, the start row, and those to predict
    parts = []
    for first in range(0, len(starts), ROLLOUTS_AT_ONCE):
        q0, own = starts[first : first + ROLLOUTS_AT_ONCE], commands[first : first + ROLLOUTS_AT_ONCE]
        shape = (len(q0), length, n_joint)
        q, qd, a = np.full(shape, np.nan), np.full(shape, np.nan), np.zeros(shape)
        q[:, : before + 1], qd[:, : before + 1] = q0[:, None], 0.0  # predictors must not use later rows
        a[:, before : before + horizon] = own
        q, qd, a = (array.reshape(-1, n_joint) for array in (q, qd, a))
        t_s = dt_s * np.arange(len(q0) * length)
        stamp_ns, training = (1e9 * t_s).astype(np.int64), np.zeros(len(t_s), bool)
        rows = Trajectory("rest", t_s, stamp_ns, q, qd, a, training)
        parts.append(predictor.predict(rows, before + length * np.arange(len(q0)), horizon))
    return finite(np.concatenate(parts))


def largest_speed(trajectories: Sequence[Trajectory], dt_s: float) -> np.ndarray:
    """Largest speed of each joint in the training rows, (n_joint,), rad/s or m/s, over `SPEED_STEPS` steps."""
    speeds = []
    for trajectory in trajectories:
        rows = trajectory.q[~trajectory.is_validation]  # they form the trajectory's beginning
        if len(rows) > SPEED_STEPS:
            speeds.append(_speeds(rows[None], dt_s).max(axis=(0, 1)))
    if not speeds:
        raise InputError(f"judge: no trajectory has {SPEED_STEPS + 1} training rows; give longer logs")
    return np.max(speeds, axis=0)


def _speeds(q: np.ndarray, dt_s: float) -> np.ndarray:
    return np.abs(q[:, SPEED_STEPS:] - q[:, :-SPEED_STEPS]) / (SPEED_STEPS * dt_s)


def _inside(q: np.ndarray, machine: MachineSpecification) -> np.ndarray:
    """Whether no joint has left its limits so far, (R, H)."""
    tolerance = LIMIT_TOLERANCE * (machine.upper - machine.lower)
    within = np.all((q >= machine.lower - tolerance) & (q <= machine.upper + tolerance), axis=-1)
    return np.logical_and.accumulate(within, axis=1)


def _constant(patterns: np.ndarray, steps: int) -> np.ndarray:
    return np.repeat(patterns[:, None], steps, axis=1)


def _over(
    values: np.ndarray, chosen: np.ndarray, statistic: Callable[[np.ndarray], np.floating]
) -> np.ndarray:
    """A statistic over each joint's chosen rollouts, (n_joint,); NaN without rollouts."""
    return np.array(
        [
            statistic(values[rollouts, joint]) if rollouts.any() else np.nan
            for joint, rollouts in enumerate(chosen.T)
        ]
    )
