"""Add what an episode of a LeRobot dataset holds to the contents of a folder."""

import numpy as np

from pipeline.errors import counted
from pipeline.logs.describe.contents import MAXIMUM_ELEMENTS, Contents
from pipeline.logs.formats.discovery.log_entry import LogEntry
from pipeline.logs.formats.lerobot.dataset import read_information
from pipeline.logs.formats.lerobot.features import Element, NoNumbersError, names_of
from pipeline.logs.formats.lerobot.frames import episode_frames
from pipeline.logs.messages.message_blocks import MAXIMUM_TIME_NS
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
        shape = description.get("shape")
        if description.get("dtype") not in NUMBERS or not isinstance(shape, list) or len(shape) != 1:
            continue
        (length,) = shape
        names = {place: f".{name}" for name, place in names_of(description).items()}
        for index in range(min(length, MAXIMUM_ELEMENTS) if isinstance(length, int) else 0):
            rest = names.get(index, "" if length == 1 and not names else f"[{index}]")
            elements[f"{feature}{rest}"] = Element(feature, index)
    stream.add_fields({path: str(information.features[e.feature]["dtype"]) for path, e in elements.items()})
    n_frames, notes = 0, list(entry.notes)
    for batch in episode_frames(entry, (), sorted({e.feature for e in elements.values()}), notes):
        n_frames += len(batch)
        for path, element in elements.items():
            if element.feature in batch.schema.names:
                try:
                    stream.fields[path].add_numbers(element.values(batch)[:, None])
                except NoNumbersError as error:
                    stream.note = str(error)
    seconds = np.minimum(np.arange(n_frames) / information.fps, MAXIMUM_TIME_NS / NANOSECONDS)
    stream.add_times(np.rint(seconds * NANOSECONDS).astype(np.int64))
    stream.end_log()
    contents.add_log(f"{entry.path}: {counted(n_frames, 'frame')} of episode {entry.part}", notes)
