"""Messages that describe themselves field by field (JSON, Protobuf): their wanted fields as `FieldGroup`s."""

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Any

import numpy as np

from pipeline.logs.messages.decoding.field_paths import EVERY, Step, steps_of
from pipeline.logs.messages.decoding.layout import FieldGroup
from pipeline.logs.messages.message_blocks import MessageBlock

INT64 = range(-(1 << 63), 1 << 63)
MAXIMUM_VALUES = 1 << 16  # of one field of one message
MAXIMUM_MESSAGE_BYTES = 64 * MAXIMUM_VALUES  # a value with its name takes fewer; parsed, 50 times as many
UNPARSED = f"they cannot be parsed, or are longer than {MAXIMUM_MESSAGE_BYTES >> 20} MiB"

Child = Callable[[Any, Step], Any]  # the value at one step below a value; None where there is no such value
Values = tuple[float | int | str, ...]


class TreeError(Exception):
    """The bytes of a message cannot be parsed."""


def decode_trees(
    block: MessageBlock, wanted: Collection[str], parse: Callable[[bytes], Any], child: Child
) -> tuple[list[FieldGroup], np.ndarray]:
    """Decode the wanted fields of a block, message by message.

    Args:
        wanted: Paths of number and text fields.
        parse: Turns the bytes of a message into a value; raises `TreeError`.
        child: Goes down one step.

    Returns:
        Groups of messages with the same number of values in each field and the same texts, and the indices of
        malformed messages, shape (n_malformed,).
    """
    paths = {path: steps_of(path) for path in _with_bases(wanted)}
    found: dict[tuple, tuple[list[int], list[dict[str, Values]]]] = {}
    malformed = []
    for number, (start, length) in enumerate(zip(block.start.tolist(), block.length.tolist(), strict=True)):
        try:
            if length > MAXIMUM_MESSAGE_BYTES:
                raise TreeError(f"{length} bytes")
            tree = parse(block.data[start : start + length].tobytes())
        except TreeError:
            malformed.append(number)
            continue
        numbers: dict[str, Values] = {}
        texts: dict[str, Values] = {}
        for path, steps in paths.items():
            values = _values(tree, steps, child)
            if values is not None:
                (texts if any(isinstance(value, str) for value in values) else numbers)[path] = values
        key = (tuple((path, len(values)) for path, values in numbers.items()), tuple(texts.items()))
        index, rows = found.setdefault(key, ([], []))
        index.append(number)
        rows.append(numbers)
    groups = [
        FieldGroup(
            np.array(index),
            {path: _column([row[path] for row in rows], n_values) for path, n_values in sizes},
            {path: tuple(str(value) for value in values) for path, values in texts},
        )
        for (sizes, texts), (index, rows) in found.items()
    ]
    return groups, np.array(malformed, dtype=np.int64)


def _with_bases(wanted: Collection[str]) -> Iterator[str]:
    """The paths, and of one that ends in an index the whole list too, by which its length is told."""
    yield from wanted
    yield from {path[: path.rindex("[")] for path in wanted if path.endswith("]")} - set(wanted)


def _values(tree: Any, steps: tuple[Step, ...], child: Child) -> Values | None:
    """The numbers, or the texts, at a path; None if there are neither."""
    for position, step in enumerate(steps):
        if step == EVERY:
            if not _is_list(tree):
                return None
            parts = [_values(element, steps[position + 1 :], child) for element in tree]
            return None if None in parts else tuple(value for part in parts if part for value in part)
        tree = child(tree, step)
        if tree is None:
            return None
    elements = [math.nan if value is None else value for value in (tree if _is_list(tree) else [tree])]
    if not all(isinstance(value, int | float | str) for value in elements):
        return None
    if len({isinstance(value, str) for value in elements}) > 1:
        return None
    return tuple(_bounded(value) for value in elements)


def _is_list(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str | bytes) and len(value) <= MAXIMUM_VALUES


def _bounded(value: float | int | str) -> float | int | str:
    if not isinstance(value, int) or value in INT64:
        return value
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _column(rows: list[Values], n_values: int) -> np.ndarray:
    is_whole = all(isinstance(value, int) for row in rows for value in row)
    return np.array(rows, np.int64 if is_whole else np.float64).reshape(len(rows), n_values)
