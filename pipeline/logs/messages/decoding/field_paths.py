"""Paths of fields in messages: `left.x`, `data[3]`, and `joints[].position` for all elements of a list."""

import re

import numpy as np

from pipeline.logs.messages.decoding.layout import FieldGroup, LayoutError
from pipeline.logs.messages.mismatch import MismatchError
from pipeline.logs.messages.raw_log import NANOSECONDS

EVERY = -1  # the step `[]`
MAXIMUM_ELEMENTS = 64  # of a list of messages, one per joint
STEP = re.compile(r"(?:^|\.)([^.\[\]]+)|\[(\d*)\]")
SECONDS_AND_NANOSECONDS = (("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanos"), ("secs", "nsecs"))

MAXIMUM_TIME_S = 1 << 32  # seconds and nanoseconds are unsigned 32-bit integers, or shorter
NO_TIME = np.iinfo(np.int64).min
SELF_DESCRIBING = ("json", "protobuf")  # encodings whose decoders know `[]`

Step = str | int


def steps_of(path: str) -> tuple[Step, ...]:
    """Split a path into names, indices, and `EVERY` for `[]`."""
    return tuple(
        match[1] if match[1] is not None else int(match[2]) if match[2] else EVERY
        for match in STEP.finditer(path)
    )


def number_at(group: FieldGroup, path: str) -> np.ndarray:
    """Return the number at a path, which may be an element of a sequence, shape (n,), float64.

    Raises:
        MismatchError: The sequence is too short.
        LayoutError: The messages have no such field.
    """
    base, _, index = path.removesuffix("]").rpartition("[")
    if path in group.numbers or not (path.endswith("]") and index.isdecimal()):
        return group.number(path).astype(np.float64)
    values = group.sequence(base)
    if int(index) >= values.shape[1]:
        raise MismatchError(f"their field `{base}` holds {values.shape[1]} values, so there is no `{path}`")
    return values[:, int(index)].astype(np.float64)


def elements(path: str, encoding: str) -> tuple[str, ...]:
    """Return the paths that stand for one with `[]`: itself, or in ROS messages those of the first elements."""
    path = path.removesuffix("[]")
    if "[]" not in path or encoding in SELF_DESCRIBING:
        return (path,)
    return tuple(path.replace("[]", f"[{number}]") for number in range(MAXIMUM_ELEMENTS))


def stamp_paths(place: str = "") -> tuple[str, ...]:
    """Return the paths of the seconds and nanoseconds of a time stamp, by ROS, Foxglove and Protobuf.

    Args:
        place: Path of the stamp; empty: `header.stamp` or `timestamp`.
    """
    parts = {name: None for names in SECONDS_AND_NANOSECONDS for name in names}
    return tuple(f"{path}.{name}" for path in _places(place) for name in parts)


def stamps_ns(group: FieldGroup, place: str = "") -> np.ndarray:
    """Return the time stamps of decoded messages, shape (n,), int64; `NO_TIME` where they hold none.

    Args:
        place: Path of the stamp; empty: `header.stamp` or `timestamp`.

    Raises:
        LayoutError: The messages have no time stamp there.
    """
    for path in _places(place):
        for seconds, nanoseconds in SECONDS_AND_NANOSECONDS:
            if f"{path}.{seconds}" in group.numbers and f"{path}.{nanoseconds}" in group.numbers:
                parts = [group.number(f"{path}.{name}") for name in (seconds, nanoseconds)]
                # Numbers of JSON are floats: NaN for text, and of any size.
                is_time = np.all([np.abs(part) <= MAXIMUM_TIME_S for part in parts], axis=0)
                whole, rest = (np.where(is_time, part, 0) for part in parts)
                second = np.floor(whole).astype(np.int64)
                fraction = np.rint((whole - second) * NANOSECONDS).astype(np.int64)  # as floats may have
                return np.where(is_time, second * NANOSECONDS + fraction + rest.astype(np.int64), NO_TIME)
    raise LayoutError(f"they have no time stamp `{'` or `'.join(_places(place))}`")


def _places(place: str) -> tuple[str, ...]:
    return (place,) if place else ("header.stamp", "timestamp")
