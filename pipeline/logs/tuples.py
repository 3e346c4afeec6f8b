"""Tuples (q, q̇, a) at the machine's rate, in and out of Parquet (contract, section 2)."""

import io
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars

from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification

TRAIN, VALIDATION = "train", "validation"
SUFFIX = ".parquet"


@dataclass(frozen=True)
class Trajectory:
    """A stretch of tuples without gaps.

    Attributes:
        name: Bag name, with `#n` appended for the n-th stretch after a gap.
        t_s: Seconds from the bag's start, shape (T,), float64.
        stamp_ns: Absolute time, shape (T,), int64.
        q: Joint positions, shape (T, n_joint), float64, rad or m.
        qd: Velocity estimates of the loop tracker, shape (T, n_joint), float64, rad/s or m/s.
        a: Commands in force, shape (T, n_joint), float64, in [-1, 1].
        is_validation: Which rows are for validation, shape (T,), bool.
    """

    name: str
    t_s: np.ndarray
    stamp_ns: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    a: np.ndarray
    is_validation: np.ndarray

    def __len__(self) -> int:
        return len(self.t_s)


def validation_part(trajectory: Trajectory) -> Trajectory:
    """Return the trajectory's validation rows, which lie at its end, as a trajectory of their own."""
    rows = trajectory.is_validation
    columns = {
        name: getattr(trajectory, name)[rows] for name in ("t_s", "stamp_ns", "q", "qd", "a", "is_validation")
    }
    return Trajectory(trajectory.name, **columns)


def bag_of(trajectory_name: str) -> str:
    """Return the bag that a trajectory is from."""
    return trajectory_name.partition("#")[0]


def write_tuples(
    directory: Path,
    machine: MachineSpecification,
    trajectories: Sequence[Trajectory],
    name: str | None = None,
) -> list[Path]:
    """Write one Parquet file per bag, each at once or not at all, byte for byte alike for alike tuples.

    Args:
        directory: Where the files go; made if need be.
        machine: Gives the columns' names.
        trajectories: Trajectories of any number of bags, each bag's in order.
        name: File name without suffix, if all trajectories are of one bag; by default the bag's name.

    Returns:
        The files written.

    Raises:
        InputError: A file cannot be written.
    """
    by_bag: dict[str, list[Trajectory]] = {}
    for trajectory in trajectories:
        by_bag.setdefault(name or bag_of(trajectory.name), []).append(trajectory)
    paths = []
    for bag, own in by_bag.items():
        content = io.BytesIO()
        polars.concat([_frame(machine, trajectory) for trajectory in own]).write_parquet(
            content, compression="zstd"
        )
        paths.append(directory / f"{bag}{SUFFIX}")
        write_whole(paths[-1], content.getbuffer())
    return paths


def write_whole(path: Path, content: bytes | memoryview) -> None:
    """Write a file so that it appears whole or not at all; its folder is made if need be.

    Raises:
        InputError: It cannot be written: the disk is full, or there is no permission.
    """
    partial = path.with_name(f".{path.name}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.write_bytes(content)
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise InputError(
            f"{path}: cannot be written ({error.strerror}); make room or check permissions"
        ) from error


def read_tuples(directory: Path, machine: MachineSpecification) -> list[Trajectory]:
    """Read all tuples of a folder, in the order of file names and of trajectories within them.

    Raises:
        InputError: The folder holds none, or a file is not one of this machine's tuples.
    """
    paths = sorted(path for path in directory.glob(f"*{SUFFIX}") if not path.name.startswith("."))
    if not paths:
        raise InputError(
            f"{directory}: no tuples (*{SUFFIX}) here; run the stage `ingest` with output={directory}"
        )
    return [trajectory for path in paths for trajectory in _read(path, machine)]


def columns(machine: MachineSpecification) -> list[str]:
    """Return the columns' names in their order."""
    joints = [f"{prefix}_{joint}" for prefix in ("q", "qd", "a") for joint in machine.joint_names]
    return ["trajectory", "t", "stamp", *joints, "split"]


def _frame(machine: MachineSpecification, trajectory: Trajectory) -> polars.DataFrame:
    data: dict[str, polars.Series | np.ndarray] = {
        "trajectory": polars.repeat(trajectory.name, len(trajectory), eager=True, dtype=polars.String),
        "t": trajectory.t_s.astype(np.float64),
        "stamp": trajectory.stamp_ns.astype(np.int64),
    }
    for prefix, values in (("q", trajectory.q), ("qd", trajectory.qd), ("a", trajectory.a)):
        for number, joint in enumerate(machine.joint_names):
            data[f"{prefix}_{joint}"] = np.ascontiguousarray(values[:, number], dtype=np.float64)
    split = np.where(trajectory.is_validation, VALIDATION, TRAIN)
    data["split"] = polars.Series(split.tolist(), dtype=polars.String)
    return polars.DataFrame(data)


def _read(path: Path, machine: MachineSpecification) -> list[Trajectory]:
    try:
        frame = polars.read_parquet(path)
    except (polars.exceptions.PolarsError, OSError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"{path}: not a readable Parquet file ({reason}); run the stage `ingest` again"
        ) from error
    missing = [column for column in columns(machine) if column not in frame.columns]
    if missing:
        raise InputError(
            f"{path}: column {', '.join(missing)} is missing; are these tuples of machine {machine.name}? "
            f"columns found: {', '.join(frame.columns)}"
        )
    unknown = sorted(set(frame["split"].unique().to_list()) - {TRAIN, VALIDATION}, key=str)
    if unknown:
        raise InputError(f"{path}: column split holds `{unknown[0]}`; it may hold {TRAIN} and {VALIDATION}")
    numeric = [column for column in columns(machine) if column not in ("trajectory", "split")]
    wrong = [column for column in numeric if not frame.schema[column].is_numeric()]
    if wrong:
        raise InputError(f"{path}: column {wrong[0]} holds {frame.schema[wrong[0]]}, not numbers")
    unusable = [
        column
        for column in numeric
        if frame[column].null_count() or not frame[column].cast(polars.Float64).is_finite().all()
    ]
    if unusable:
        raise InputError(
            f"{path}: column {unusable[0]} has missing or infinite values; run the stage `ingest` again"
        )
    parts = frame.partition_by("trajectory", maintain_order=True)
    return [_trajectory(part, machine) for part in parts]


def _trajectory(part: polars.DataFrame, machine: MachineSpecification) -> Trajectory:
    def matrix(prefix: str) -> np.ndarray:
        return np.stack(
            [part[f"{prefix}_{joint}"].cast(polars.Float64).to_numpy() for joint in machine.joint_names],
            axis=1,
        )

    return Trajectory(
        name=part["trajectory"][0],
        t_s=part["t"].cast(polars.Float64).to_numpy(),
        stamp_ns=part["stamp"].cast(polars.Int64).to_numpy(),
        q=matrix("q"),
        qd=matrix("qd"),
        a=matrix("a"),
        is_validation=(part["split"] == VALIDATION).to_numpy(),
    )
