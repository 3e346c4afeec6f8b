"""What a model misses on a sound machine: its floor, the evidence (`motion_window`) of sound driving.

A joint's limit is what 99 % of windows reach in which the floor's own motion is slowed. The window is the shortest that
leaves the hours asked for between two false stops. Those follow from the highest evidence in each run of a window's
length, less the limit: runs err nearly independently. The upper tenth is a generalised Pareto tail, whose profile
likelihood bounds the chance to reach the limit (Coles, An Introduction to Statistical Modeling of Extreme Values, 2001,
ch. 4). The logs' own kind of driving is taken for granted: only hours that were driven tell of others.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.deployment.components.supervision.free_running_model import FreeRunningModel
from pipeline.deployment.components.supervision.motion_window import MotionSteps, evidence
from pipeline.errors import InputError
from pipeline.files.atomic import write_json
from pipeline.logs.tuples import Trajectory

WINDOWS_S = (2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
LATER_SHARE = 0.01  # of slowed windows that stay below the limit
TAIL_SHARE = 0.1
FEWEST_RUNS = 100  # ten in the tail
BELOW_BEST = 1.35  # of the log-likelihood: half of chi-squared's 90 %, on one side nominally 95 %
SCHEMA_VERSION = 3


@dataclass(frozen=True)
class ModelFloor:
    """How a joint is told that no longer follows its model.

    Attributes:
        model: fingerprint of the model.
        speed: share of its speed at which a joint is told.
        window_steps: steps of motion of one joint that are judged together.
        hours: least mean time between false stops while all joints move, up to what was asked for.
        limit: (n_joint,) evidence at which a joint no longer follows.
    """

    model: str
    speed: float
    window_steps: int
    hours: float
    limit: np.ndarray

    def write(self, path: Path) -> None:
        """Write a JSON file."""
        write_json(path, {"schema_version": SCHEMA_VERSION, **vars(self), "limit": self.limit.tolist()})


def read_floor(path: Path, model: str) -> ModelFloor:
    """Read the floor of the model with this fingerprint.

    Raises:
        InputError: the file is missing, damaged, of another version or another model.
    """
    remedy = "run measure_floor with this model"
    try:
        content = json.loads(path.read_text())
        if (version := content.pop("schema_version")) != SCHEMA_VERSION:
            raise InputError(
                f"{path}: a floor of version {version}, not {SCHEMA_VERSION}; measure it again: {remedy}"
            )
        floor = ModelFloor(**{**content, "limit": np.array(content["limit"], float)})
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; {remedy}") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: not a model's floor ({error}); {remedy}") from error
    if floor.model != model:
        raise InputError(f"{path}: is the floor of another model; {remedy}")
    return floor


def measure_floor(
    follower: FreeRunningModel,
    model: str,
    trajectories: Sequence[Trajectory],
    seen_in_fit: Sequence[str],
    speed: float,
    hours: float,
) -> ModelFloor:
    """The floor over rows of sound driving: all rows, but only the validation rows of what the model was fitted to.

    Args:
        follower: the model.
        model: its fingerprint.
        trajectories: tuples of its machine.
        seen_in_fit: names of the trajectories that it was fitted to.
        speed: share of its speed at which a joint has to be told.
        hours: asked for between two false stops. If no window leaves them, the one that leaves most is taken.

    Raises:
        InputError: there is too little motion.
    """
    if not 0.0 <= speed < 1.0:
        raise InputError(f"measure_floor: speed is {speed}; give a share below 1")
    specification = follower.specification
    steps, n_joint = MotionSteps(specification, speed), len(specification.joints)
    lengths = [round(window_s / specification.dt_s) for window_s in WINDOWS_S]
    sound, slowed = ({n: [[np.zeros(0)] for _ in range(n_joint)] for n in lengths} for _ in range(2))
    for trajectory in trajectories:
        expected, measured = follower.displacements(trajectory.q, trajectory.a), np.diff(trajectory.q, axis=0)
        around = steps.around(expected)
        is_judged = np.arange(len(around)) >= follower.settling_steps
        if trajectory.name.partition("#")[0] in seen_in_fit:
            is_judged &= trajectory.is_validation[: len(around)]
        at, around = np.flatnonzero(is_judged), around[is_judged]
        for share, found in ((1.0, sound), (speed, slowed)):
            moved = share * measured[at]
            counts = steps.count(trajectory.q[at], around, moved)
            for joint, counted in enumerate(counts.T):
                terms = steps.terms(around[counted, joint], moved[counted, joint])
                sums = np.cumsum(np.pad(terms, ((1, 0), (0, 0), (0, 0))), axis=0)
                for n, of in found.items():
                    of[joint].append(evidence(sums[n:] - sums[:-n]))
    floors = []
    for n in lengths:
        reached = [np.concatenate(of) for of in slowed[n]]
        runs = [np.concatenate([highest(each, n) for each in of]) for of in sound[n]]
        if min(map(len, reached)) and sum(map(len, runs)) >= FEWEST_RUNS:
            limit = np.array([np.quantile(of, LATER_SHARE) for of in reached])
            over = np.concatenate([of - at for of, at in zip(runs, limit.tolist(), strict=True)])
            run_hours = n * specification.dt_s / 3600.0 / n_joint
            most = chance(over)
            carried = run_hours / most if most * hours > run_hours else hours
            floors.append(ModelFloor(model, speed, n, carried, limit))
    if not floors:
        raise InputError(
            f"measure_floor: too little motion that no fit saw: {FEWEST_RUNS} windows of {WINDOWS_S[0]:g} s are "
            "needed, and one of each joint; give longer logs"
        )
    return max(floors, key=lambda floor: floor.hours)


def highest(values: np.ndarray, n: int) -> np.ndarray:
    """The highest of each n successive values, of (T,)."""
    return np.maximum.reduceat(values, np.arange(0, len(values), n)) if len(values) else values


def chance(over: np.ndarray) -> float:
    """Upper bound of the chance that a run reaches its limit; of (n,) highest evidence less the limit.

    Of 50 runs in the tail it holds 8 to 9 times in 10, of exponential, bounded and normal evidence.
    """
    start = float(np.quantile(over, 1.0 - TAIL_SHARE))
    if start >= min(0.0, float(over.max())):  # no tail to go on from; none of n leaves 3 / n
        return max(float(np.mean(over >= 0.0)), 3.0 / len(over))
    excess = over[over > start] - start
    scale = excess.mean() * np.geomspace(0.2, 5.0, 61)[:, None]
    likelihood, reached = [], []
    for shape in np.arange(-0.975, 1.0, 0.05).tolist():
        with np.errstate(divide="ignore"):
            log = np.log(np.maximum(1.0 + shape * excess / scale, 0.0))
        likelihood.append(-len(excess) * np.log(scale[:, 0]) - (1.0 + 1.0 / shape) * log.sum(axis=1))
        reached.append(np.maximum(1.0 - shape * start / scale[:, 0], 0.0) ** (-1.0 / shape))
    is_likely = np.array(likelihood) >= np.max(likelihood) - BELOW_BEST
    return TAIL_SHARE * float(np.array(reached)[is_likely].max())
