"""The cells of the DVC graph, `params.yaml`: logs, models and seeds."""

from pathlib import Path
from typing import Any

import yaml

from pipeline.errors import InputError

# The product of these keys gives the models that policies are learned on; that of `icem_<key>` gives iCEM's models.
CONTROLLED = ("models", "targets")


def read_cells(path: Path, *keys: str) -> dict[str, Any]:
    """Read `params.yaml`.

    Args:
        keys: Required keys.

    Raises:
        InputError: The file is missing, is not YAML, or lacks one of the keys.
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


def read_controller_cells(path: Path, *keys: str) -> dict[str, Any]:
    """Read the keys of the controllers, for `controllers.controllers_of`, and other keys.

    Raises:
        InputError: See `read_cells`; or iCEM's keys are missing, or name a model that is not identified.
    """
    content = read_cells(path, *CONTROLLED, "seeds", *keys)
    for key in (*CONTROLLED, "seeds"):
        _check_list(path, content, key)
    if not content.get("icem_variants"):
        return content
    _check_list(path, content, "icem_variants")
    examples = {f"icem_{key}": content[key] for key in CONTROLLED} | {"icem_seeds": content["seeds"][:1]}
    for key, example in examples.items():
        if key not in content:
            raise InputError(
                f"cells={path}: has icem_variants, but no {key}; add `{key}: {_shown(example)}`, "
                "or name the project's params.yaml"
            )
        _check_list(path, content, key)
    for key in CONTROLLED:
        others = [value for value in content[f"icem_{key}"] if value not in content[key]]
        if others:
            raise InputError(
                f"cells={path}: icem_{key} has {_shown(others)}, which {key} has not, so there is no such model; "
                f"add it to {key}, or take it out of icem_{key}"
            )
    return content


def _check_list(path: Path, content: dict[str, Any], key: str) -> None:
    if not isinstance(content[key], list):
        raise InputError(f"cells={path}: {key} is {content[key]}; it must be a list in square brackets")


def _shown(values: list[Any]) -> str:
    return f"[{', '.join(map(str, values))}]"
