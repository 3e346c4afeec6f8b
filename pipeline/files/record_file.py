"""A record of numbers, arrays and further records as one `.npz` file, from which a page can be made later."""

import dataclasses
import enum
import io
import json
import types
import zipfile
from pathlib import Path
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from pipeline.errors import InputError
from pipeline.files.atomic import write_whole

STRUCTURE = "structure"  # the record as JSON; in place of each array stands its name in the file
R = TypeVar("R")


def save_record(path: Path, record: Any) -> None:
    """Write a dataclass; arrays keep their types and values exactly, and equal records give equal bytes.

    Args:
        path: Where to; the folder is made if need be.
        record: Its fields hold arrays, strings, numbers, None, enumerations of strings, other dataclasses, and lists,
            tuples and dictionaries (by string) of these.

    Raises:
        InputError: The file cannot be written.
    """
    arrays: dict[str, np.ndarray] = {}

    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            name = f"array_{len(arrays)}"
            arrays[name] = value
            return name
        if dataclasses.is_dataclass(value):
            return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
        if isinstance(value, dict):
            return {key: plain(entry) for key, entry in value.items()}
        if isinstance(value, list | tuple):
            return [plain(entry) for entry in value]
        return value.item() if isinstance(value, np.generic) else value

    structure = json.dumps(plain(record))
    content = io.BytesIO()
    np.savez_compressed(content, allow_pickle=False, **{STRUCTURE: np.array(structure)}, **arrays)
    write_whole(path, content.getbuffer())


def load_record(path: Path, kind: type[R]) -> R:
    """Read what `save_record` wrote of a dataclass `kind`.

    Raises:
        InputError: The file is missing, or does not hold such a record.
    """
    try:
        with np.load(path, allow_pickle=False) as content:
            arrays = dict(content)
        built: R = _built(kind, json.loads(str(arrays[STRUCTURE])), arrays)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; run the stage that writes it first") from error
    except (ValueError, KeyError, TypeError, AttributeError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path}: does not hold the expected record ({error}); run the stage again"
        ) from error
    return built


def _built(kind: Any, value: Any, arrays: dict[str, np.ndarray]) -> Any:
    """A value of the type `kind` from its plain form."""
    parts = get_args(kind)
    if kind is np.ndarray:
        return arrays[value]
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        hints = get_type_hints(kind)
        return kind(**{name: _built(hints[name], entry, arrays) for name, entry in value.items()})
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return kind(value)
    if get_origin(kind) in (Union, types.UnionType):
        return (
            None
            if value is None
            else _built(next(p for p in parts if p is not types.NoneType), value, arrays)
        )
    if get_origin(kind) is dict:
        return {key: _built(parts[1], entry, arrays) for key, entry in value.items()}
    if get_origin(kind) in (list, tuple):
        entries = [_built(parts[0], entry, arrays) for entry in value]
        return tuple(entries) if get_origin(kind) is tuple else entries
    return value
