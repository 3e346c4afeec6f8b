"""What a model misses on a sound machine: its floor, in blocks of motion of one joint.

A block is `BLOCK_STEPS` steps in which the joint moves, or the model expects it to. R is the sum of measured less
expected displacements, M the sum of the larger of their two sizes. Scores compare half the expected speed with the
expected one, for normal errors of the floor's size σ:

    s = (M / 2) (|R| - M / 4) / σ²

A joint within a quarter of its expected speed scores below zero: it follows, and its p-value is one. Else the rank of
its score among the floor's gives a conformal p-value. An e-value is κ p^(κ-1) (Vovk and Wang, E-values, Annals of
Statistics 2021). With κ = 1 / ln(n + 1) it is largest for a block that is worse than all n of the floor. Ranks take no
shape of errors for granted.

Evidence of a joint is the logarithm of the product of successive blocks' e-values, begun anew where it falls below 0.
Did sound blocks err independently, they would number at least b on average before one reaches ln b (Shin, Ramdas and
Rinaldo, E-detectors, 2024). A late start spoils several: sums over runs of blocks vary D times as much, and b blocks
reach D ln b, as a random walk does of this spread (Siegmund, Sequential Analysis, 1985). What outlasts a
run, as a cold start of the engine, is not in D: only hours that were driven tell of it.

A joint's limit is what a share of its speed reaches within so many seconds of motion, which leaves the longest time
between false stops: `measure_floor` slows the motion of its own logs to see it.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pipeline.deployment.components.supervision.free_running_model import FreeRunningModel
from pipeline.dynamics.model.shown_motion import NEAR_SHARE, STANDING_SHARE
from pipeline.dynamics.model.specification import ModelSpecification
from pipeline.errors import InputError
from pipeline.files.atomic import write_json
from pipeline.logs.tuples import Trajectory

BLOCK_STEPS = 4
LATER_SHARE = 0.01  # of slowed motion that takes longer
FEWEST_BLOCKS = (
    100  # of fewer, two seconds of blocks that are all worse are no evidence of once in 3000 hours
)
SCHEMA_VERSION = 2


class Blocks(NamedTuple):
    """Blocks of one joint, (n,) each: R and M, rad (m)."""

    residual: np.ndarray
    motion: np.ndarray


class MovingSteps:
    """Which steps count: the joint moves or should, and is not pushed into an end of its range."""

    def __init__(self, specification: ModelSpecification) -> None:
        lower, upper = np.array(specification.position_lower), np.array(specification.position_upper)
        margin = NEAR_SHARE * (upper - lower)
        self._lower, self._upper = lower + margin, upper - margin
        self._standing = STANDING_SHARE * specification.dt_s * np.array(specification.velocity_limit)

    def count(self, q: np.ndarray, expected: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """Of steps from `q` with two displacements, (..., n_joint) each; bool of that shape."""
        is_pushed = ((q < self._lower) & (expected < 0)) | ((q > self._upper) & (expected > 0))
        return (np.maximum(np.abs(expected), np.abs(measured)) > self._standing) & ~is_pushed


@dataclass(frozen=True)
class ModelFloor:
    """Blocks of sound driving.

    Attributes:
        model: fingerprint of the model.
        scale: (n_joint,) root mean square of R, rad (m).
        scores: (n,) of all joints' blocks, ascending.
        limit: (n_joint,) evidence at which a joint no longer follows its model.
        dependence: (n_joint,) D of sound driving, in runs as long as it takes to tell a slow joint.
    """

    model: str
    scale: np.ndarray
    scores: np.ndarray
    limit: np.ndarray
    dependence: np.ndarray

    @property
    def n_blocks(self) -> float:
        """Least number of sound blocks on average between two false stops."""
        return float(np.exp((self.limit / self.dependence).min()))

    def log_e_value(self, joint: int, residual: ArrayLike, motion: ArrayLike) -> np.ndarray:
        """Logarithms of blocks' e-values, of R and M, rad (m), all of one shape."""
        n = len(self.scores)
        scores = score(residual, motion, self.scale[joint])
        worse = np.where(scores < 0.0, n, n - np.searchsorted(self.scores, scores, side="left"))
        exponent = 1.0 / np.log(n + 1)
        return np.asarray(np.log(exponent) + (exponent - 1.0) * np.log((1 + worse) / (n + 1)))

    def write(self, path: Path) -> None:
        """Write a JSON file."""
        content = {
            "schema_version": SCHEMA_VERSION,
            "model": self.model,
            "scale": self.scale.tolist(),
            "limit": self.limit.tolist(),
            "dependence": self.dependence.tolist(),
            "scores": np.round(self.scores, 4).tolist(),
        }
        write_json(path, content)


def score(residual: ArrayLike, motion: ArrayLike, scale: float) -> np.ndarray:
    """Log-likelihood ratio of half the expected speed to the expected one; R, M and σ, rad (m)."""
    return np.asarray(motion) / 2 * (np.abs(residual) - np.asarray(motion) / 4) / scale**2


def read_floor(path: Path, model: str) -> ModelFloor:
    """Read the floor of the model with this fingerprint.

    Raises:
        InputError: the file is missing, damaged, or of another model.
    """
    remedy = "run measure_floor with this model"
    try:
        content = json.loads(path.read_text())
        columns = (np.array(content[name], float) for name in ("scale", "scores", "limit", "dependence"))
        floor = ModelFloor(str(content["model"]), *columns)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; {remedy}") from error
    except (ValueError, KeyError, TypeError) as error:
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
    within_s: float,
) -> ModelFloor:
    """The floor over rows of sound driving: all rows, but only the validation rows of what the model was fitted to.

    Args:
        follower: the model.
        model: its fingerprint.
        trajectories: tuples of its machine.
        seen_in_fit: names of the trajectories that it was fitted to.
        speed: share of its speed at which a joint has to be told.
        within_s: motion until then.

    Raises:
        InputError: there are too few blocks, or a time in which not two of them end.
    """
    n_blocks_within = round(within_s / follower.specification.dt_s) // BLOCK_STEPS - 1  # one begins before
    if not (0.0 <= speed < 1.0 and n_blocks_within >= 1):
        raise InputError(
            f"measure_floor: speed is {speed} and within_s is {within_s}; give a share below 1, and at least "
            f"{2 * BLOCK_STEPS * follower.specification.dt_s:g} s"
        )
    moving = MovingSteps(follower.specification)
    of_joint: list[list[Blocks]] = [[] for _ in follower.specification.joints]
    slowed: list[list[Blocks]] = [[] for _ in follower.specification.joints]
    for trajectory in trajectories:
        expected, measured = follower.displacements(trajectory.q, trajectory.a), np.diff(trajectory.q, axis=0)
        is_known = np.arange(len(expected)) < follower.settling_steps
        if trajectory.name.partition("#")[0] in seen_in_fit:
            is_known |= ~trajectory.is_validation[:-1]
        for moved, found in ((measured, of_joint), (measured * speed, slowed)):
            counts = moving.count(trajectory.q[:-1], expected, moved) & ~is_known[:, None]
            for joint, blocks in enumerate(found):
                rows = np.flatnonzero(counts[:, joint])
                blocks.append(blocks_of(expected[rows, joint], moved[rows, joint]))
    joined = [_joined(blocks) for blocks in of_joint]
    n_blocks = sum(len(blocks.residual) for blocks in joined)
    least = min(sum(len(blocks.residual) for blocks in of) for of in slowed)
    is_enough = least >= n_blocks_within and all(np.any(blocks.residual) for blocks in joined)
    if n_blocks < FEWEST_BLOCKS or not is_enough:
        raise InputError(
            f"{n_blocks} blocks of motion that no fit saw, of the joint that moved least {least}; {FEWEST_BLOCKS} and "
            f"{n_blocks_within} are needed: give longer logs"
        )
    scale = np.array([np.sqrt(np.mean(blocks.residual**2)) for blocks in joined])
    scores = [score(*blocks, of) for blocks, of in zip(joined, scale.tolist(), strict=True)]
    floor = ModelFloor(
        model, scale, np.sort(np.concatenate(scores)), np.zeros_like(scale), np.ones_like(scale)
    )
    limit = [
        np.quantile(_reached(floor.log_e_value(joint, *_joined(blocks)), n_blocks_within), LATER_SHARE)
        for joint, blocks in enumerate(slowed)
    ]
    alike = [
        dependence(floor.log_e_value(joint, *blocks), n_blocks_within) for joint, blocks in enumerate(joined)
    ]
    return replace(floor, limit=np.array(limit), dependence=np.array(alike))


def blocks_of(expected: np.ndarray, measured: np.ndarray) -> Blocks:
    """Blocks of one joint's counted steps, (T,) displacements each; an incomplete one is left out."""
    n = len(expected) // BLOCK_STEPS * BLOCK_STEPS
    residual = (measured - expected)[:n].reshape(-1, BLOCK_STEPS).sum(axis=1)
    motion = np.maximum(np.abs(measured), np.abs(expected))[:n].reshape(-1, BLOCK_STEPS).sum(axis=1)
    return Blocks(residual, motion)


def evidence(log_e_values: np.ndarray) -> np.ndarray:
    """Evidence of one joint after each of its blocks, (n,)."""
    reached, products = 0.0, np.empty(len(log_e_values))
    for number, value in enumerate(log_e_values.tolist()):
        reached = max(reached, 0.0) + value
        products[number] = reached
    return products


def dependence(log_e_values: np.ndarray, n_blocks: int) -> float:
    """How many times as much sums of so many successive blocks, of (n,), vary as if they were independent; from 1."""
    if not np.ptp(log_e_values):
        return 1.0
    sums = np.lib.stride_tricks.sliding_window_view(log_e_values, n_blocks).sum(axis=1)
    return max(1.0, float(np.var(sums) / (n_blocks * np.var(log_e_values))))


def _reached(log_e_values: np.ndarray, n_blocks: int) -> np.ndarray:
    """Highest evidence within every run of so many blocks."""
    runs = np.lib.stride_tricks.sliding_window_view(log_e_values, n_blocks)
    return np.array([evidence(run).max() for run in runs])


def _joined(blocks: Sequence[Blocks]) -> Blocks:
    return Blocks(*map(np.concatenate, zip(*blocks, strict=True)))
