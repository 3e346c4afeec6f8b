"""Adapters that positions, commands and channels share: fields by path, values by name, conversion, header stamps."""

from collections.abc import Callable

import numpy as np

from pipeline.logs.messages.decoding.field_paths import elements, number_at, stamp_paths, stamps_ns
from pipeline.logs.messages.decoding.layout import FieldGroup, LayoutError
from pipeline.logs.messages.message_blocks import LoggedTopic
from pipeline.logs.messages.mismatch import MismatchError
from pipeline.logs.messages.topic_columns import Adapter


class FieldColumn:
    """Any message: fields by path (`left.x`, `data[3]`, `axes[0].value`) → a column of shape (n, n_paths)."""

    def __init__(self, role: str, column: str, paths: list[str]) -> None:
        self.role, self.column, self.paths = role, column, paths

    def wanted(self, topic: LoggedTopic) -> tuple[str, ...]:
        """The paths."""
        return tuple(self.paths)

    def convert(self, group: FieldGroup) -> dict[str, np.ndarray]:
        """Pick each path's value."""
        return {self.column: np.stack([number_at(group, path) for path in self.paths], axis=1)}


class NamedColumn:
    """Any message that names its joints → a column of the machine's joints, shape (n, n_joint).

    Names and values stand in two lists, or in a list of messages. `names_and_values` returns their paths for a topic.
    """

    def __init__(
        self,
        role: str,
        column: str,
        joint_names: tuple[str, ...],
        names_and_values: Callable[[LoggedTopic], tuple[str, str]],
    ) -> None:
        self.role, self.column, self.joint_names = role, column, joint_names
        self.names_and_values = names_and_values
        self.paths: list[tuple[str, ...]] = []  # of those in the last block

    def wanted(self, topic: LoggedTopic) -> tuple[str, ...]:
        """Names and values."""
        self.paths = [elements(path, topic.encoding) for path in self.names_and_values(topic)]
        return tuple(path for paths in self.paths for path in paths)

    def convert(self, group: FieldGroup) -> dict[str, np.ndarray]:
        """Pick the machine's joints by name."""
        of_names, of_values = self.paths
        listed = [group.strings[path] for path in of_names if path in group.strings]
        names = tuple(name for part in listed or [group.text(of_names[0])] for name in part)
        parts = [group.numbers[path] for path in of_values if path in group.numbers]
        values = np.concatenate(parts or [group.sequence(of_values[0])], axis=1)
        return {self.column: _by_name(names, values, self.joint_names, of_values[0])}


class Converted:
    """Another adapter, with one of its columns converted."""

    def __init__(self, adapter: Adapter, column: str, conversion: Callable[[np.ndarray], np.ndarray]) -> None:
        self.role, self.wanted = adapter.role, adapter.wanted
        self.adapter, self.column, self.conversion = adapter, column, conversion

    def convert(self, group: FieldGroup) -> dict[str, np.ndarray]:
        """Convert the adapter's column."""
        columns = self.adapter.convert(group)
        return {**columns, self.column: self.conversion(columns[self.column])}


class Stamped:
    """Another adapter, with the messages' time stamps as column `stamp_ns`, shape (n,), int64.

    Messages without a stamp are left out, or have zero if `is_needed` is false; log time then replaces it.
    """

    def __init__(self, adapter: Adapter, place: str = "", is_needed: bool = True) -> None:
        self.role = adapter.role
        self.adapter, self.place, self.is_needed = adapter, place, is_needed

    def wanted(self, topic: LoggedTopic) -> tuple[str, ...]:
        """The adapter's fields and the stamp."""
        return (*self.adapter.wanted(topic), *stamp_paths(self.place))

    def convert(self, group: FieldGroup) -> dict[str, np.ndarray]:
        """Add the stamps."""
        columns = self.adapter.convert(group)
        try:
            stamps = stamps_ns(group, self.place)
        except LayoutError:
            if self.is_needed:
                raise
            stamps = np.zeros(len(group.index), np.int64)
        return {**columns, "stamp_ns": stamps}


def _by_name(
    names: tuple[str, ...], values: np.ndarray, joint_names: tuple[str, ...], field_name: str
) -> np.ndarray:
    """Return the values of the machine's joints, picked by the names of all, shape (n, n_joint), float64.

    Raises:
        MismatchError: A joint is missing or listed twice, or there are more or fewer values than names.
    """
    missing = [joint for joint in joint_names if joint not in names]
    if missing:
        raise MismatchError(
            f"joint {', '.join(missing)} is missing; names in the messages: {', '.join(names) or 'none'}"
        )
    repeated = [joint for joint in joint_names if names.count(joint) > 1]
    if repeated:
        raise MismatchError(f"joint {', '.join(repeated)} stands there more than once: {', '.join(names)}")
    if values.shape[1] != len(names):
        raise MismatchError(
            f"their field `{field_name}` holds {values.shape[1]} values for {len(names)} names"
        )
    return values[:, [names.index(joint) for joint in joint_names]].astype(np.float64)
