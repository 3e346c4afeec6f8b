"""The cells of the graph, `params.yaml`: which logs, models and seeds there are."""

from pathlib import Path
from typing import Any

import yaml

from pipeline.errors import InputError


def read_cells(path: Path, *keys: str) -> dict[str, Any]:
    """Read `params.yaml`.

    Args:
        path: The file.
        keys: What it must state.

    Raises:
        InputError: There is no such file, it is not YAML, or does not state one of the keys.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            f"cells={path}: cannot be read ({error.strerror}); name the project's params.yaml"
        ) from error
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f"cells={path}: not YAML ({error}); name the project's params.yaml") from error
    missing = [key for key in keys if not isinstance(content, dict) or key not in content]
    if missing:
        raise InputError(f"cells={path}: has no {', '.join(missing)}; name the project's params.yaml")
    return content
