"""Files that appear whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pipeline.errors import InputError

PARTIAL_SUFFIX = ".partial"  # of hidden files that a killed process may leave


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a path to write to, which takes the place of `path` once the block ends without an error.

    The folder is made if need be; a file of an earlier run stays as it is until then.

    Raises:
        InputError: The file cannot be written: the disk is full, or there is no permission.
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
        with suppress(OSError):  # where the folder is none, what says so has been raised
            partial.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes | memoryview) -> None:
    """Write a file at once.

    Raises:
        InputError: As of `replacing`.
    """
    with replacing(path) as partial:
        partial.write_bytes(content)
