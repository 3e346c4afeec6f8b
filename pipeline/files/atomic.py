"""Atomic writes: a file appears complete or not at all."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pipeline.errors import InputError

PARTIAL_SUFFIX = ".partial"  # hidden files that a killed process may leave behind


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary path; its file replaces `path` once the block ends without an error.

    A missing folder is created. A file of an earlier run stays unchanged until then.

    Raises:
        InputError: The file cannot be written: the disk is full, or permission is missing.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}{PARTIAL_SUFFIX}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield partial
        os.replace(partial, path)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror or error}); make room or check permissions"
        ) from error
    finally:
        with suppress(OSError):  # if the folder is a file, the error above was raised
            partial.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes | memoryview) -> None:
    """Write a file atomically.

    Raises:
        InputError: The file cannot be written.
    """
    with atomic_path(path) as partial:
        partial.write_bytes(content)


def write_json(path: Path, content: object, *, sort_keys: bool = False, allow_nan: bool = True) -> None:
    """Write a JSON document atomically.

    Raises:
        InputError: The file cannot be written.
        ValueError: A number is not finite, without `allow_nan`.
    """
    text = json.dumps(content, indent=1, sort_keys=sort_keys, allow_nan=allow_nan, ensure_ascii=False)
    write_whole(
        path, f"{text}\n".encode(errors="backslashreplace")
    )  # half a surrogate pair becomes JSON's \\ud800
