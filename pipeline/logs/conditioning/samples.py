"""Streams of timed samples, which the rules of conditioning transform section by section.

A rule is a generator over such a stream. The division into sections does not change any rule's result.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Self

import numpy as np


@dataclass(frozen=True)
class Samples:
    """A section of a stream.

    Attributes:
        time_ns: shape (n,), int64.
        value: Joint positions or commands, shape (n, n_joint), float64.
        era: Number of the stretch between steps of the clock that the section lies in.
        stretch: Number of the stretch between jumps of an encoder that the section lies in; counts on over eras.
    """

    time_ns: np.ndarray
    value: np.ndarray
    era: int = 0
    stretch: int = 0

    def __len__(self) -> int:
        return len(self.time_ns)

    def __getitem__(self, rows: slice | np.ndarray) -> Self:
        return replace(self, time_ns=self.time_ns[rows], value=self.value[rows])


def join(parts: list[Samples]) -> Samples:
    """Join sections of one stretch."""
    return replace(
        parts[0],
        time_ns=np.concatenate([part.time_ns for part in parts]),
        value=np.concatenate([part.value for part in parts]),
    )


def with_neighbours(stream: Iterable[Samples]) -> Iterator[tuple[Samples, int, int]]:
    """Yield each section with its neighbouring samples of the same era.

    Yields:
        The widened section, and the section's bounds within it. No section is empty.
    """
    before: Samples | None = None
    held: Samples | None = None
    for section in stream:
        if not len(section):
            continue
        if held is not None:
            after = section[:1] if section.era == held.era else None
            yield _widened(before, held, after)
            before = held[-1:] if after is not None else None
        held = section
    if held is not None:
        yield _widened(before, held, None)


def _widened(before: Samples | None, section: Samples, after: Samples | None) -> tuple[Samples, int, int]:
    begin = 0 if before is None else len(before)
    parts = [part for part in (before, section, after) if part is not None]
    return replace(join(parts), era=section.era, stretch=section.stretch), begin, begin + len(section)
