"""Columns of numbers that are gathered block by block and read section by section, in memory or on disk.

All data of a log's length are stored here, so that a log of ten hours takes no more memory than one of ten minutes. A
NumPy array is a column, too.
"""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Protocol, Self, cast

import numpy as np

from pipeline.errors import InputError

SECTION_ROWS = 1 << 15  # a few megabytes of joint samples at a time


class Column(Protocol):
    """Rows of numbers, read by slices of step one."""

    def __len__(self) -> int: ...

    def __getitem__(self, rows: slice, /) -> np.ndarray: ...


class ColumnStore(Protocol):
    """Stores blocks of columns and returns complete columns."""

    def append(self, table: str, block: Mapping[str, np.ndarray]) -> None:
        """Append rows to the columns of a table; every block of a table has the same columns."""
        ...

    def columns(self, table: str) -> dict[str, Column]:
        """Return a table's columns, which are closed from now on; empty if nothing was appended."""
        ...


class MemoryStore:
    """Columns in memory, for callers that need the whole log anyway."""

    def __init__(self) -> None:
        self.blocks: dict[str, list[Mapping[str, np.ndarray]]] = {}

    def append(self, table: str, block: Mapping[str, np.ndarray]) -> None:
        """Keep the block."""
        self.blocks.setdefault(table, []).append(block)

    def columns(self, table: str) -> dict[str, Column]:
        """Join the blocks."""
        blocks = self.blocks.get(table, [])
        return {
            name: np.concatenate([block[name] for block in blocks]) for name in (blocks[0] if blocks else ())
        }


class DiskStore:
    """Columns in files of a scratch folder, which is deleted with the store."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.files: dict[str, dict[str, BinaryIO]] = {}
        self.layouts: dict[str, dict[str, tuple[np.dtype, tuple[int, ...]]]] = {}

    def __enter__(self) -> Self:
        """Create the folder and delete the remains of a killed run."""
        shutil.rmtree(self.folder, ignore_errors=True)
        try:
            self.folder.mkdir(parents=True)
        except OSError as error:
            raise self._refusal(error) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close and remove everything."""
        for files in self.files.values():
            for file in files.values():
                with suppress(OSError):  # a full disk was reported by `append`
                    file.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def append(self, table: str, block: Mapping[str, np.ndarray]) -> None:
        """Append the block's bytes.

        Raises:
            InputError: The disk is full, or permission is missing.
        """
        try:
            if table not in self.files:
                self.files[table] = {name: (self.folder / f"{table}.{name}").open("w+b") for name in block}
                self.layouts[table] = {name: (rows.dtype, rows.shape[1:]) for name, rows in block.items()}
            for name, rows in block.items():
                dtype, _ = self.layouts[table][name]
                self.files[table][name].write(np.ascontiguousarray(rows, dtype).data)
        except OSError as error:
            raise self._refusal(error) from error

    def columns(self, table: str) -> dict[str, Column]:
        """Return columns that read from the files.

        Raises:
            InputError: The disk is full.
        """
        try:
            for file in self.files.get(table, {}).values():
                file.flush()
        except OSError as error:
            raise self._refusal(error) from error
        return {
            name: _DiskColumn(file, *self.layouts[table][name])
            for name, file in self.files.get(table, {}).items()
        }

    def _refusal(self, error: OSError) -> InputError:
        return InputError(
            f"{self.folder}: cannot be written ({error.strerror}); make room or check permissions"
        )


class _DiskColumn:
    """A column in a file."""

    def __init__(self, file: BinaryIO, dtype: np.dtype, row_shape: tuple[int, ...]) -> None:
        self.file, self.dtype, self.row_shape = file, dtype, row_shape
        self.row_bytes = dtype.itemsize * int(np.prod(row_shape, dtype=np.int64))
        self.n_rows = file.seek(0, 2) // self.row_bytes if self.row_bytes else 0

    def __len__(self) -> int:
        return self.n_rows

    def __getitem__(self, rows: slice) -> np.ndarray:
        begin, end, _ = rows.indices(self.n_rows)
        try:
            self.file.seek(begin * self.row_bytes)
            content = bytearray(self.file.read(max(end - begin, 0) * self.row_bytes))
        except OSError as error:
            raise InputError(
                f"{self.file.name}: cannot be read ({error.strerror}); check the disk"
            ) from error
        return np.frombuffer(content, self.dtype).reshape(-1, *self.row_shape)


def sections(
    columns: Sequence[Column], begin: int = 0, end: int | None = None, n_rows: int | None = None
) -> Iterator[tuple[np.ndarray, ...]]:
    """Yield equal slices of columns of equal length, `n_rows` rows at a time (default: `SECTION_ROWS`)."""
    n_rows = n_rows or SECTION_ROWS
    end = len(columns[0]) if end is None else end
    for row in range(begin, end, n_rows):
        yield tuple(column[row : min(row + n_rows, end)] for column in columns)


def extent(column: Column) -> tuple[int, int]:
    """Return the smallest and the largest value of a column of integers."""
    parts = [(part.min(), part.max()) for (part,) in sections((column,))]
    return int(min(low for low, _ in parts)), int(max(high for _, high in parts))


def as_array(column: Column) -> np.ndarray:
    """Return a column as one array."""
    return cast(np.ndarray, column[0 : len(column)])
