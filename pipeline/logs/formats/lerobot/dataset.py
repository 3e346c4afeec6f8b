"""What a LeRobot dataset says of itself (`meta/info.json`), and the episodes in its files."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.errors import InputError, first_line

INFORMATION = Path("meta") / "info.json"
VERSION = "v3."
MAXIMUM_INFORMATION_BYTES = 1 << 22
MAXIMUM_EPISODES = 100_000  # of a file
TOTALS = ("total_episodes", "total_frames")
EPISODE, LENGTH = "episode_index", "length"
READING_FAULTS = (pa.ArrowException, OSError, ValueError, OverflowError)


@dataclass(frozen=True)
class DatasetInformation:
    """Of `meta/info.json`.

    Attributes:
        fps: Frames per second.
        features: By name: `dtype`, `shape`, `names`.
        totals: `total_episodes` and `total_frames`, where they are stated.
    """

    fps: float
    features: dict[str, dict[str, Any]]
    totals: dict[str, int]


def is_dataset(directory: Path) -> bool:
    """Whether a folder is a LeRobot dataset of any version."""
    try:
        with (directory / INFORMATION).open("rb") as file:
            return b'"codebase_version"' in file.read(MAXIMUM_INFORMATION_BYTES)
    except OSError:
        return False


def read_information(directory: Path) -> DatasetInformation:
    """Read `meta/info.json`.

    Raises:
        InputError: It is damaged, or of another version.
    """
    path = directory / INFORMATION
    try:
        with path.open("rb") as file:
            content = json.loads(file.read(MAXIMUM_INFORMATION_BYTES))
        version, fps, features = str(content["codebase_version"]), float(content["fps"]), content["features"]
        if not all(isinstance(feature, dict) for feature in features.values()):
            raise TypeError("features are not descriptions")
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        reason = first_line(error)[:80]
        raise InputError(f"{path}: not a LeRobot dataset's description ({reason})") from error
    if not version.startswith(VERSION):
        raise InputError(
            f"{path}: version {version[:20]} is not read; convert it with lerobot's script to v3.0"
        )
    if not 0 < fps < 1e6:
        raise InputError(f"{path}: fps is {fps}; it must be positive")
    totals = {key: content[key] for key in TOTALS if isinstance(content.get(key), int)}
    return DatasetInformation(fps, features, totals)


def data_files(directory: Path) -> list[Path]:
    """The files of frames, in order."""
    return sorted((directory / "data").glob("*/*.parquet"))


@dataclass(frozen=True)
class EpisodeFrames:
    """Where an episode's frames stand in a file: the first row, the row behind the last one, and their number."""

    begin: int
    end: int
    count: int


def episodes_of(path: Path) -> dict[int, EpisodeFrames]:
    """Episodes in a file of frames, in order of their numbers.

    Raises:
        InputError: The file cannot be read.
    """
    found: dict[int, EpisodeFrames] = {}
    fault: Exception | None = None
    try:
        with pq.ParquetFile(path) as file:
            row = 0
            for group in range(file.num_row_groups):
                try:
                    for number, frames in _episodes_of_group(file, group, row):
                        known = found.get(number, EpisodeFrames(frames.begin, frames.end, 0))
                        found[number] = EpisodeFrames(known.begin, frames.end, known.count + frames.count)
                        if len(found) > MAXIMUM_EPISODES:
                            raise InputError(
                                f"{path}: holds more than {MAXIMUM_EPISODES} episodes; split the dataset"
                            )
                except READING_FAULTS as error:
                    fault = fault or error
                row += file.metadata.row_group(group).num_rows
    except READING_FAULTS as error:
        fault = fault or error
    if fault is not None and not found:
        raise InputError(f"{path}: not a readable table ({first_line(fault)})") from fault
    return dict(sorted(found.items()))


def _episodes_of_group(file: pq.ParquetFile, group: int, row: int) -> Iterator[tuple[int, EpisodeFrames]]:
    """Yield the episodes of a row group that begins at a row, batch by batch."""
    for batch in file.iter_batches(columns=[EPISODE], row_groups=[group]):
        numbers = episode_numbers(batch.column(0))
        episodes, first, count = np.unique(numbers, return_index=True, return_counts=True)
        last = len(numbers) - 1 - np.unique(numbers[::-1], return_index=True)[1]
        for episode, *place in zip(*(a.tolist() for a in (episodes, first, last, count)), strict=True):
            if episode >= 0:
                yield episode, EpisodeFrames(row + place[0], row + place[1] + 1, place[2])
        row += len(batch)


def episode_numbers(column: pa.Array) -> np.ndarray:
    """The episodes of frames, shape (n,), int64; -1 where a frame has none. Raises `pa.ArrowException`."""
    return column.cast(pa.int64()).fill_null(-1).to_numpy(zero_copy_only=False)


def stated_lengths(directory: Path) -> dict[int, int]:
    """Number of frames of each episode, as the dataset's list of episodes states them; empty if it cannot be read."""
    lengths: dict[int, int] = {}
    for path in sorted((directory / "meta" / "episodes").glob("*/*.parquet")):
        try:
            table = pq.read_table(path, columns=[EPISODE, LENGTH])
            episodes, own = (table[name].cast(pa.int64()).to_pylist() for name in (EPISODE, LENGTH))
            lengths |= dict(zip(episodes, own, strict=True))
        except (*READING_FAULTS, KeyError):
            continue
    return {episode: length for episode, length in lengths.items() if isinstance(length, int)}
