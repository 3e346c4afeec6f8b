"""Episodic conditions, and the fixed episodes of the evaluation (paper, "Episodic conditions")."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from pipeline.errors import InputError
from pipeline.machine.kinematics import Arm
from pipeline.machine.poses import PoseConditions, PoseTable, build_pose_table, sample_configurations
from pipeline.machine.specification import MachineSpecification


@dataclass
class EpisodesConfig:
    """Section `episodes` of a profile.

    Attributes:
        pitch_max_rad: α^max, bound on the pitch of starts, and of targets while learning.
        pitch_max_task_rad: α^ts, bound on the pitch of targets in evaluation.
        z_min_task_m: lowest target in evaluation.
        z_max_task_m: highest target in evaluation.
        steps: T_reset, ticks per episode; the time-out is not a terminal state.
        table_rows: number of poses drawn beforehand, from which learning draws starts and targets.
        evaluation_episodes: number N of fixed episodes.
        evaluation_seed: seed of their starts and targets.
        curve_seed: seed of the episodes for learning curves; must differ from `evaluation_seed`.
    """

    pitch_max_rad: float
    pitch_max_task_rad: float
    z_min_task_m: float
    z_max_task_m: float
    steps: int
    table_rows: int
    evaluation_episodes: int
    evaluation_seed: int
    curve_seed: int

    def __post_init__(self) -> None:
        for name in ("steps", "table_rows", "evaluation_episodes"):
            if getattr(self, name) < 1:
                raise InputError(f"episodes.{name} is {getattr(self, name)}; it must be at least 1")
        if self.curve_seed == self.evaluation_seed:
            raise InputError(
                f"episodes.curve_seed is {self.curve_seed}, as episodes.evaluation_seed; choose another: the "
                "evaluation's episodes may decide nothing while learning"
            )
        if not 0.0 < self.pitch_max_task_rad <= self.pitch_max_rad:
            raise InputError(
                f"episodes.pitch_max_task_rad is {self.pitch_max_task_rad}; it must be positive and not "
                f"above pitch_max_rad ({self.pitch_max_rad})"
            )
        if not self.z_min_task_m < self.z_max_task_m:
            raise InputError(
                f"episodes.z_min_task_m {self.z_min_task_m} is not below z_max_task_m {self.z_max_task_m}"
            )

    @property
    def learning_conditions(self) -> PoseConditions:
        """Conditions of all starts, and of targets while learning."""
        return PoseConditions(pitch_max_rad=self.pitch_max_rad, z_min_m=None, z_max_m=None)

    @property
    def task_conditions(self) -> PoseConditions:
        """Conditions of targets in evaluation."""
        return PoseConditions(
            pitch_max_rad=self.pitch_max_task_rad, z_min_m=self.z_min_task_m, z_max_m=self.z_max_task_m
        )


# Folded into a training's key for its table of poses. PPO's draws with the same seed, and the episodes of a curve or an
# evaluation with the same seed, thus come from other streams. Any large number would do; a small n would not, since
# `fold_in(key, n)` is the n-th key of `split(key, ...)`.
_POSE_TABLE_STREAM = 0x706F7365


class Episodes(NamedTuple):
    """Starts and targets of N episodes, as configurations, rad (m), each of shape (N, n_joint), float32."""

    starts: np.ndarray
    targets: np.ndarray

    def first(self, n: int) -> "Episodes":
        """The first `n` episodes, or as many as there are.

        Raises:
            InputError: `n` is below 1.
        """
        if n < 1:
            raise InputError(f"{n} episodes are asked for; ask for at least 1")
        return Episodes(self.starts[:n], self.targets[:n])


def evaluation_episodes(
    machine: MachineSpecification, arm: Arm, config: EpisodesConfig, seed: int, n: int
) -> Episodes:
    """Episodes fixed by the seed: starts from the learning conditions, targets from those of the task.

    Raises:
        InputError: the machine has no workspace, or hardly any pose meets the conditions.
    """
    start_key, target_key = jax.random.split(jax.random.key(seed))
    starts = sample_configurations(start_key, machine, arm, config.learning_conditions, n)
    targets = sample_configurations(target_key, machine, arm, config.task_conditions, n)
    return Episodes(np.asarray(starts), np.asarray(targets))


def learning_poses(machine: MachineSpecification, arm: Arm, config: EpisodesConfig, seed: int) -> PoseTable:
    """The table of starts and targets for learning.

    Args:
        config: conditions and size.
        seed: seed of the training; the table has its own stream, so it shares no episode with `evaluation_episodes`.

    Raises:
        InputError: the machine has no workspace, or hardly any pose meets the conditions.
    """
    key = jax.random.fold_in(jax.random.key(seed), _POSE_TABLE_STREAM)
    return build_pose_table(key, machine, arm, config.learning_conditions, config.table_rows)


def save_episodes(path: Path, episodes: Episodes) -> None:
    """Write the episodes to an .npz file, byte-stable."""
    np.savez(path, starts=episodes.starts, targets=episodes.targets)


def load_episodes(path: Path) -> Episodes:
    """Read the output of `save_episodes`.

    Raises:
        InputError: the file is missing, or `save_episodes` did not write it.
    """
    try:
        with np.load(path) as content:
            return Episodes(content["starts"], content["targets"])
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; run the evaluation that writes it") from None
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: not a file of episodes ({error}); write it anew") from None
