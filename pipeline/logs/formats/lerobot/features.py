"""Where a machine's joints stand among the features of a LeRobot dataset."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.errors import InputError


class NoNumbersError(InputError):
    """A feature holds something else."""


@dataclass(frozen=True)
class Element:
    """One number of a feature: the feature's name, and the number's position in it."""

    feature: str
    index: int

    def values(self, batch: pa.RecordBatch) -> np.ndarray:
        """Return the numbers of a batch of frames, shape (n,), float64; NaN where a frame lacks it.

        Raises:
            NoNumbersError: The column holds something else.
        """
        column = batch.column(batch.schema.get_field_index(self.feature))
        kind = column.type
        if pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind):
            lengths = pc.list_value_length(column).fill_null(0).to_numpy(zero_copy_only=False)
            is_there = lengths > self.index
            values = np.full(len(column), np.nan)
            if is_there.any():
                values[is_there] = _floats(
                    pc.list_element(column.filter(pa.array(is_there)), self.index), self.feature
                )
            return values
        return _floats(column, self.feature)


def element_of(entry: str, features: dict[str, dict[str, Any]], place: str) -> Element:
    """Find `FEATURE[3]`, or `FEATURE.NAME` by the names that the dataset gives the feature's numbers.

    Raises:
        InputError: There is no such feature or name.
    """
    for feature in sorted((name for name in features if entry.startswith(name)), key=len, reverse=True):
        rest, names = entry[len(feature) :], names_of(features[feature])
        if not rest:
            return Element(feature, 0)
        if rest.startswith("[") and rest.endswith("]") and rest[1:-1].isdecimal():
            return Element(feature, int(rest[1:-1]))
        if rest.startswith(".") and rest[1:] in names:
            return Element(feature, names[rest[1:]])
        if rest.startswith("."):
            listed = ", ".join(list(names)[:24]) or "no names; use [0], [1], …"
            raise InputError(f"{place}: feature {feature} has no number `{rest[1:]}`; it has {listed}")
    raise InputError(f"{place}: no feature `{entry}`; the dataset has {', '.join(list(features)[:24])}")


def names_of(feature: dict[str, Any]) -> dict[str, int]:
    """The positions of a feature's numbers by their names, without names that repeat; empty if these are not given.

    They are a list, lists in a dictionary (`{"motors": [...]}`), or a dictionary of positions (`{"boom": 0}`).
    """
    names = feature.get("names")
    if isinstance(names, dict):
        if all(type(place) is int and place >= 0 for place in names.values()):
            return names
        parts = names.values()
        names = [name for part in parts for name in part] if all(isinstance(p, list) for p in parts) else None
    if not isinstance(names, list):
        return {}
    return {str(name): place for place, name in enumerate(names) if names.count(name) == 1}


def _floats(column: pa.Array, feature: str) -> np.ndarray:
    try:
        return column.cast(pa.float64(), safe=False).fill_null(np.nan).to_numpy(zero_copy_only=False)
    except (pa.ArrowException, NotImplementedError) as error:
        raise NoNumbersError(f"feature {feature} holds {column.type}, not numbers") from error
