"""Tuples (q, q̇, a) at the machine's rate, read from and written to Parquet (contract, section 2)."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow
from pyarrow.parquet import ParquetFile, ParquetWriter, read_schema

from pipeline.errors import InputError, first_line
from pipeline.files.atomic import atomic_path
from pipeline.machine.specification import MachineSpecification

if TYPE_CHECKING:
    import polars  # else where tuples are read: training a policy reads none, and needs no package of 170 MB

TRAIN, VALIDATION = "train", "validation"
SUFFIX = ".parquet"
ROW_GROUP_ROWS = 1 << 14


@dataclass(frozen=True)
class Trajectory:
    """A gap-free stretch of tuples.

    Attributes:
        name: Bag name, with `#n` appended for the n-th stretch after a gap.
        t_s: Seconds from the bag's start, shape (T,), float64.
        stamp_ns: Absolute time, shape (T,), int64.
        q: Joint positions, shape (T, n_joint), float64, rad or m.
        qd: Velocity estimates of the loop tracker, shape (T, n_joint), float64, rad/s or m/s.
        a: Commands in force, shape (T, n_joint), float64, in [-1, 1].
        is_validation: Which rows are for validation, shape (T,), bool.
        channels: Channels by name, each shape (T,), float64, in its own unit; NaN where none holds.
    """

    name: str
    t_s: np.ndarray
    stamp_ns: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    a: np.ndarray
    is_validation: np.ndarray
    channels: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.t_s)


def validation_part(trajectory: Trajectory) -> Trajectory:
    """Return the validation rows at the trajectory's end as a trajectory."""
    rows = trajectory.is_validation
    columns = {
        name: getattr(trajectory, name)[rows] for name in ("t_s", "stamp_ns", "q", "qd", "a", "is_validation")
    }
    channels = {name: values[rows] for name, values in trajectory.channels.items()}
    return Trajectory(trajectory.name, **columns, channels=channels)


def write_tuples(path: Path, machine: MachineSpecification, sections: Iterable[Trajectory]) -> None:
    """Write one Parquet file atomically; equal tuples give equal bytes.

    Args:
        path: The file; a missing folder is created.
        machine: Gives the columns' names.
        sections: Trajectories in their order, whole or in consecutive sections.

    Raises:
        InputError: The file cannot be written.
    """
    schema = _schema(machine)
    repeating = [name for name in schema.names if name.startswith("a_") or name in ("trajectory", "split")]
    with (
        atomic_path(path) as partial,
        ParquetWriter(partial, schema, compression="zstd", use_dictionary=repeating) as writer,
    ):
        for group in _row_groups(sections):
            parts = [_table(machine, schema, section) for section in group]
            writer.write_table(pyarrow.concat_tables(parts).combine_chunks())


def read_tuples(directory: Path, machine: MachineSpecification) -> list[Trajectory]:
    """Read all tuples of a folder, in the order of file names and of trajectories within them.

    Raises:
        InputError: The folder holds no tuples, or a file does not hold this machine's tuples.
    """
    paths = sorted(path for path in directory.glob(f"*{SUFFIX}") if not path.name.startswith("."))
    if not paths:
        raise InputError(
            f"{directory}: no tuples (*{SUFFIX}) here; name a folder that the stage `ingest` wrote"
        )
    return [trajectory for path in paths for trajectory in _read(path, machine)]


def is_tuple_file(path: Path) -> bool:
    """Whether `write_tuples` wrote the Parquet file, for any machine."""
    try:
        names = read_schema(path).names
    except (OSError, pyarrow.ArrowException):
        return False
    return names[:3] == ["trajectory", "t", "stamp"] and names[-1] == "split"


def thinned_positions(path: Path, machine: MachineSpecification, maximum_rows: int) -> np.ndarray:
    """Return the positions of every n-th row of one file, at most `maximum_rows`, shape (n_rows, n_joint).

    Memory holds one row group at a time.
    """
    names = [f"q_{joint}" for joint in machine.joint_names]
    file = ParquetFile(path)
    stride = max(1, -(-file.metadata.num_rows // maximum_rows))
    parts, behind = [], 0  # rows since the last one taken
    for batch in file.iter_batches(columns=names):
        values = np.stack([batch.column(name).to_numpy() for name in names], axis=1)
        parts.append(values[-behind % stride :: stride])
        behind = (behind + len(values)) % stride
    return np.concatenate(parts)


def columns(machine: MachineSpecification) -> list[str]:
    """Return the columns' names in order."""
    joints = [f"{prefix}_{joint}" for prefix in ("q", "qd", "a") for joint in machine.joint_names]
    return ["trajectory", "t", "stamp", *joints, *_channel_columns(machine), "split"]


def _channel_columns(machine: MachineSpecification) -> list[str]:
    return [f"x_{channel}" for channel in machine.channel_names]


def _schema(machine: MachineSpecification) -> pyarrow.Schema:
    types = {"trajectory": pyarrow.string(), "stamp": pyarrow.int64(), "split": pyarrow.string()}
    return pyarrow.schema([(name, types.get(name, pyarrow.float64())) for name in columns(machine)])


def _row_groups(sections: Iterable[Trajectory]) -> Iterator[list[Trajectory]]:
    """Gather short trajectories into row groups of sufficient size."""
    group: list[Trajectory] = []
    for section in sections:
        group.append(section)
        if sum(map(len, group)) >= ROW_GROUP_ROWS:
            yield group
            group = []
    if group:
        yield group


def _table(machine: MachineSpecification, schema: pyarrow.Schema, section: Trajectory) -> pyarrow.Table:
    data: dict[str, Sequence | np.ndarray] = {
        "trajectory": [section.name] * len(section),
        "t": section.t_s,
        "stamp": section.stamp_ns,
        "split": np.where(section.is_validation, VALIDATION, TRAIN),
    }
    for prefix, values in (("q", section.q), ("qd", section.qd), ("a", section.a)):
        for number, joint in enumerate(machine.joint_names):
            data[f"{prefix}_{joint}"] = np.ascontiguousarray(values[:, number], dtype=np.float64)
    for name in machine.channel_names:
        values = section.channels.get(name, np.full(len(section), np.nan))
        data[f"x_{name}"] = pyarrow.array(values, pyarrow.float64(), from_pandas=True)  # NaN becomes null
    return pyarrow.table([data[name] for name in schema.names], schema=schema)


def _read(path: Path, machine: MachineSpecification) -> list[Trajectory]:
    import polars

    try:
        frame = polars.read_parquet(path)
    except (polars.exceptions.PolarsError, polars.exceptions.PanicException, OSError) as error:
        reason = first_line(error)
        raise InputError(
            f"{path}: not a readable Parquet file ({reason}); run the stage `ingest` again"
        ) from error
    expected = [name for name in columns(machine) if name not in _channel_columns(machine)]  # may be missing
    missing = [column for column in expected if column not in frame.columns]
    if missing:
        raise InputError(
            f"{path}: column {', '.join(missing)} is missing; are these tuples of machine {machine.name}? "
            f"columns found: {', '.join(frame.columns)}"
        )
    unknown = sorted(set(frame["split"].unique().to_list()) - {TRAIN, VALIDATION}, key=str)
    if unknown:
        raise InputError(f"{path}: column split holds `{unknown[0]}`; it may hold {TRAIN} and {VALIDATION}")
    numeric = [column for column in expected if column not in ("trajectory", "split")]
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


def _trajectory(part: "polars.DataFrame", machine: MachineSpecification) -> Trajectory:
    import polars

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
        channels={
            name: part[f"x_{name}"].cast(polars.Float64).fill_null(float("nan")).to_numpy()
            for name in machine.channel_names
            if f"x_{name}" in part.columns
        },
    )
