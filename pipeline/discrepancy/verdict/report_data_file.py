"""A closed loop's report data as one `.npz` file, so that its page is made from files alone."""

import dataclasses
import io
import json
import zipfile
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np

from pipeline.discrepancy.verdict.report_data import ReportData
from pipeline.errors import InputError
from pipeline.files.atomic import write_whole

FILE = "report_data.npz"
STRUCTURE = "structure"  # the record as JSON; in place of each array stands its name in the file


def save_report_data(path: Path, data: ReportData) -> None:
    """Write it; arrays keep their types and values exactly.

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

    structure = json.dumps(plain(data))
    content = io.BytesIO()
    np.savez_compressed(content, allow_pickle=False, **{STRUCTURE: np.array(structure)}, **arrays)
    write_whole(path, content.getbuffer())


def load_report_data(path: Path) -> ReportData:
    """Read what `save_report_data` wrote.

    Raises:
        InputError: The file is missing or is no such file.
    """
    try:
        with np.load(path, allow_pickle=False) as content:
            arrays = dict(content)
        built = _built(ReportData, json.loads(str(arrays[STRUCTURE])), arrays)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; run close_loop first") from error
    except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: is not what close_loop writes ({error}); run it again") from error
    assert isinstance(built, ReportData)
    return built


def _built(kind: Any, value: Any, arrays: dict[str, np.ndarray]) -> Any:
    """A value of the type `kind` from its plain form."""
    if kind is np.ndarray:
        return arrays[value]
    if dataclasses.is_dataclass(kind) and isinstance(kind, type):
        hints = get_type_hints(kind)
        return kind(**{name: _built(hints[name], entry, arrays) for name, entry in value.items()})
    if get_origin(kind) is dict:
        return {key: _built(get_args(kind)[1], entry, arrays) for key, entry in value.items()}
    if get_origin(kind) is list:
        return [_built(get_args(kind)[0], entry, arrays) for entry in value]
    return value
