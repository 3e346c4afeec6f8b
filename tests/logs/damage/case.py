"""What a case of damage is, and the list that builders put themselves on.

A case is a builder that makes the log in an empty folder. It returns what is to be read and what is known of it from
how it was made: how many messages must be recovered at least, what the line must say, whether the log is usable.
"""

import enum
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.logs.samples.whole_logs import (
    BAGS,
    CAN,
    SELF_DESCRIBING,
    TABLES,
    Chunk,
    WholeLog,
    whole_log,
)

REFUSED = 2  # exit status
SQLITE_PAGE = 4096
EVERY_KIND = (*BAGS, *TABLES, *SELF_DESCRIBING, *CAN)


class Where(enum.Enum):
    """What a case needs around it."""

    here = "in this process"
    fused = "in a process of its own, whose memory is measured and limited"
    unprivileged = "in a process that permissions bind, even where the tests run as root"
    full_disk = "with files that may not grow"


@dataclass(frozen=True)
class Damaged:
    """A damaged log and what must come of it.

    Attributes:
        path: What is read: a file or a folder.
        at_least: Messages that must be recovered.
        says: Regular expressions that the lines given must match, each at least one of them.
        status: 0 where the log is usable, `REFUSED` where it is not.
        may_differ: Messages whose values may be others than recorded, where the format carries no checksum.
        n_whole: Messages before the damage, where it is another number than the whole log's.
    """

    path: Path
    at_least: int
    says: tuple[str, ...] = ()
    status: int = 0
    may_differ: int = 0
    n_whole: int | None = None


Builder = Callable[[Path, WholeLog], Damaged]


@dataclass(frozen=True)
class DamageCase:
    """One case: a kind of damage to one kind of log."""

    name: str
    kind: str
    builder: Builder
    where: Where
    only_read: bool  # not hashed too, which takes its time with ten gigabytes

    def build(self, folder: Path) -> Damaged:
        """Make the log in an empty folder."""
        return self.builder(folder, whole_log(self.kind))

    def __str__(self) -> str:
        return f"{self.name} ({self.kind})"


REGISTERED: list[DamageCase] = []


def case(
    name: str, *kinds: str, where: Where = Where.here, only_read: bool = False
) -> Callable[[Builder], Builder]:
    """Put a builder on the list, once for each kind of log."""

    def register(builder: Builder) -> Builder:
        REGISTERED.extend(DamageCase(name, kind, builder, where, only_read) for kind in kinds)
        return builder

    return register


def at_byte(offset: int) -> str:
    return rf"byte {offset}\b"


def flipped(content: bytes, at: int, bit: int = 4) -> bytes:
    damaged = bytearray(content)
    damaged[at] ^= 1 << bit
    return bytes(damaged)


def refused(path: Path, *says: str) -> Damaged:
    return Damaged(path, 0, (path.name.replace(".", r"\."), *says), REFUSED)


def all_but(log: WholeLog, path: Path, chunk: Chunk) -> Damaged:
    """All messages but those of one chunk, whose place is told."""
    return Damaged(path, log.n_messages - chunk.n_messages, (f"{path.name}, {at_byte(chunk.start)}",))
