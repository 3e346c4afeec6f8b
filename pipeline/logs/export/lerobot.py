"""Write trajectories as a LeRobot dataset, version 3, that `lerobot`'s own loader opens.

Each trajectory is an episode. Features: `observation.state` (positions), `action` (commands), both float32 and named by
joint, and `stamp` (ns since 1970). Source: lerobot.datasets of lerobot 0.4.
"""

import json
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.errors import InputError
from pipeline.files.atomic import PARTIAL_SUFFIX, write_json
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification

FILE_MB, FILES_PER_CHUNK = 100, 1000  # as `lerobot` writes
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
NUMBERS = ("timestamp", "frame_index", "episode_index", "index", "task_index")


def write_lerobot(
    path: Path, machine: MachineSpecification, trajectories: Iterable[Trajectory], task: str
) -> int:
    """Write a dataset; the folder appears complete or not at all.

    Args:
        path: The dataset's folder, which must not exist yet.
        machine: Names joints and rate.
        task: What the machine does in them, in words, as LeRobot wants it.

    Returns:
        The number of episodes.

    Raises:
        InputError: The folder exists, or there are no trajectories.
    """
    if path.exists():
        raise InputError(f"{path}: exists already; remove it or name another folder")
    partial = path.with_name(f".{path.name}{PARTIAL_SUFFIX}")
    shutil.rmtree(partial, ignore_errors=True)
    (partial / "meta").mkdir(parents=True)
    fps: float = int(machine.rate_hz) if float(machine.rate_hz).is_integer() else machine.rate_hz
    episodes: list[dict[str, Any]] = []
    writer: pq.ParquetWriter | None = None
    n_frames = n_files = n_bytes = 0
    for number, trajectory in enumerate(trajectories):
        if writer is None or n_bytes >= FILE_MB * 1_000_000:
            if writer is not None:
                writer.close()
            place = {"chunk_index": n_files // FILES_PER_CHUNK, "file_index": n_files % FILES_PER_CHUNK}
            file = partial / DATA_PATH.format(**place)
            file.parent.mkdir(parents=True, exist_ok=True)
            writer = pq.ParquetWriter(file, _schema(machine), write_page_checksum=True)
            n_bytes, n_files = 0, n_files + 1
        columns = _columns(trajectory, number, n_frames, fps)
        table = _table(columns, _schema(machine))
        writer.write_table(table)
        n_bytes += table.nbytes
        episodes.append(_episode(columns, number, n_frames, task, place))
        n_frames += len(trajectory.q)
    if writer is None:
        shutil.rmtree(partial)
        raise InputError(f"{path}: no trajectories to write; name a folder of tuples")
    writer.close()
    _write_episodes(partial, episodes)
    _write_tasks(partial / "meta" / "tasks.parquet", task)
    write_json(partial / "meta" / "stats.json", _all_statistics(episodes))
    write_json(partial / "meta" / "info.json", _information(machine, fps, len(episodes), n_frames))
    partial.rename(path)
    return len(episodes)


def _columns(trajectory: Trajectory, episode: int, begin: int, fps: float) -> dict[str, np.ndarray]:
    number = np.arange(len(trajectory.q), dtype=np.int64)
    return {
        "observation.state": trajectory.q.astype(np.float32),
        "action": trajectory.a.astype(np.float32),
        "stamp": trajectory.stamp_ns,
        "timestamp": (number / fps).astype(np.float32),
        "frame_index": number,
        "episode_index": np.full(len(number), episode),
        "index": begin + number,
        "task_index": np.zeros(len(number), np.int64),
    }


def _features(machine: MachineSpecification) -> dict[str, dict[str, Any]]:
    joints = {"dtype": "float32", "shape": [machine.n_joint], "names": list(machine.joint_names)}
    whole: dict[str, Any] = {"dtype": "int64", "shape": [1], "names": None}
    return {
        "observation.state": joints,
        "action": joints,
        "stamp": whole,
        "timestamp": {**whole, "dtype": "float32"},
        **dict.fromkeys(NUMBERS[1:], whole),
    }


def _schema(machine: MachineSpecification) -> pa.Schema:
    types = {"float32": pa.float32(), "int64": pa.int64()}
    fields = []
    for name, feature in _features(machine).items():
        kind, (length,) = types[feature["dtype"]], feature["shape"]
        fields.append(pa.field(name, kind if length == 1 else pa.list_(kind, length)))
    return pa.schema(fields)


def _table(columns: dict[str, np.ndarray], schema: pa.Schema) -> pa.Table:
    arrays = [
        pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
        if values.ndim == 2 and values.shape[1] > 1
        else pa.array(values.ravel())
        for values in columns.values()
    ]
    return pa.Table.from_arrays(arrays, schema=schema)


def _episode(
    columns: dict[str, np.ndarray], number: int, begin: int, task: str, place: dict[str, int]
) -> dict[str, Any]:
    n_frames = len(columns["index"])
    episode: dict[str, Any] = {
        "episode_index": number,
        "tasks": [task],
        "length": n_frames,
        **{f"data/{key}": value for key, value in place.items()},
        "dataset_from_index": begin,
        "dataset_to_index": begin + n_frames,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }
    for name, values in columns.items():
        table = values.reshape(n_frames, -1).astype(np.float64)
        statistics = {"min": table.min(axis=0), "max": table.max(axis=0), "mean": table.mean(axis=0)}
        statistics |= {"std": table.std(axis=0), "count": np.array([n_frames])}
        statistics |= {key: np.quantile(table, share, axis=0) for key, share in QUANTILES.items()}
        episode |= {f"stats/{name}/{key}": value.tolist() for key, value in statistics.items()}
    return episode


def _all_statistics(episodes: list[dict[str, Any]]) -> dict[str, dict[str, list[float]]]:
    """Statistics over all episodes, as LeRobot joins them: quantiles are weighted means of those of the episodes."""
    found: dict[str, dict[str, list[float]]] = {}
    for name in (
        key.removeprefix("stats/").removesuffix("/min") for key in episodes[0] if key.endswith("/min")
    ):
        of = {
            key: np.array([episode[f"stats/{name}/{key}"] for episode in episodes])
            for key in ("min", "max", "mean", "std", "count", *QUANTILES)
        }
        share = of["count"] / of["count"].sum()
        mean = (share * of["mean"]).sum(axis=0)
        variance = (share * (of["std"] ** 2 + (of["mean"] - mean) ** 2)).sum(axis=0)
        joined = {"min": of["min"].min(axis=0), "max": of["max"].max(axis=0), "mean": mean}
        joined |= {"std": np.sqrt(variance), "count": of["count"].sum(axis=0)}
        joined |= {key: (share * of[key]).sum(axis=0) for key in QUANTILES}
        found[name] = {key: value.tolist() for key, value in joined.items()}
    return found


def _write_episodes(folder: Path, episodes: list[dict[str, Any]]) -> None:
    path = folder / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    path.parent.mkdir(parents=True)
    pq.write_table(pa.Table.from_pylist(episodes), path)


def _write_tasks(path: Path, task: str) -> None:
    """The table of tasks, whose pandas index is the task's words."""
    index = "__index_level_0__"
    keys = ("name", "field_name", "pandas_type", "numpy_type", "metadata")
    columns = [("task_index", "task_index", "int64", "int64", None), (None, index, "unicode", "object", None)]
    pandas: dict[str, Any] = {"index_columns": [index], "column_indexes": [], "pandas_version": "2.2.0"}
    pandas["columns"] = [dict(zip(keys, column, strict=True)) for column in columns]
    table = pa.table({"task_index": pa.array([0], pa.int64()), index: pa.array([task])})
    pq.write_table(table.replace_schema_metadata({"pandas": json.dumps(pandas)}), path)


def _information(machine: MachineSpecification, fps: float, n_episodes: int, n_frames: int) -> dict[str, Any]:
    return {
        "codebase_version": "v3.0",
        "robot_type": machine.name,
        "total_episodes": n_episodes,
        "total_frames": n_frames,
        "total_tasks": 1,
        "chunks_size": FILES_PER_CHUNK,
        "data_files_size_in_mb": FILE_MB,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": f"0:{n_episodes}"},
        "data_path": DATA_PATH,
        "video_path": None,
        "features": _features(machine),
    }
