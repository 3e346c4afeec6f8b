"""Readers of the stages' files, with errors that name the stage to run."""

import json
from pathlib import Path
from typing import Any

from pipeline.errors import InputError


def require_file(path: Path) -> Path:
    """Return the path if it exists.

    Raises:
        InputError: The file is missing.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file; run the stage that writes it first (dvc repro)")
    return path


def read_json(path: Path) -> dict[str, Any]:
    """Content of a JSON file.

    Raises:
        InputError: The file is missing or not JSON.
    """
    try:
        return json.loads(require_file(path).read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: not JSON ({error}); run the stage that writes it again") from error
