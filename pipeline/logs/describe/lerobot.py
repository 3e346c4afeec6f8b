"""Add what an episode of a LeRobot dataset holds to the contents of a folder."""

import numpy as np
import pyarrow.parquet as pq

from pipeline.errors import InputError, first_line
from pipeline.logs.describe.contents import MAXIMUM_ELEMENTS, Contents
from pipeline.logs.formats.discover import LogEntry
from pipeline.logs.formats.lerobot.dataset import EPISODE, READING_FAULTS, read_information
from pipeline.logs.formats.lerobot.features import Element, names_of
from pipeline.logs.messages.raw_log import NANOSECONDS

DATASET = "LeRobot dataset"  # type of the stream
NUMBERS = ("float32", "float64", "int8", "int16", "int32", "int64", "bool")


def add_episode(entry: LogEntry, contents: Contents) -> None:
    """Add the features of an episode, each number by its path, and their ranges.

    Raises:
        InputError: The dataset cannot be read.
    """
    information = read_information(entry.path)
    stream = contents.stream((DATASET, entry.path.name), entry.path.name, DATASET)
    elements = {}
    for feature, description in information.features.items():
        shape, names = description.get("shape"), names_of(description)
        if description.get("dtype") not in NUMBERS or not isinstance(shape, list) or len(shape) != 1:
            continue
        (length,) = shape
        for index in range(min(length, MAXIMUM_ELEMENTS) if isinstance(length, int) else 0):
            rest = (
                ""
                if length == 1 and not names
                else f".{names[index]}"
                if index < len(names)
                else f"[{index}]"
            )
            elements[f"{feature}{rest}"] = Element(feature, index)
    stream.add_fields({path: str(information.features[e.feature]["dtype"]) for path, e in elements.items()})
    n_frames = 0
    try:
        with pq.ParquetFile(entry.files[0]) as file:
            wanted = [
                name
                for name in {EPISODE, *(e.feature for e in elements.values())}
                if name in file.schema_arrow.names
            ]
            for batch in file.iter_batches(columns=wanted):
                is_own = Element(EPISODE, 0).values(batch) == entry.part
                n_frames += int(is_own.sum())
                for path, element in elements.items():
                    if element.feature in wanted:
                        stream.fields[path].add_numbers(element.values(batch)[is_own][:, None])
    except InputError as error:
        raise InputError(f"{entry.files[0]}: {error}") from error
    except READING_FAULTS as error:
        raise InputError(f"{entry.files[0]}: not a readable table ({first_line(error)})") from error
    times = np.rint(np.arange(n_frames) / information.fps * NANOSECONDS).astype(np.int64)
    stream.end_log(n_frames, [times])
    contents.logs.append(f"{entry.path}: {n_frames} frames of episode {entry.part}")
