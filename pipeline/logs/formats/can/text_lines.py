"""Lines of a text file of unknown content, of bounded length, for `python-can`'s readers."""

import re
from collections.abc import Callable, Iterator
from io import BufferedReader

from pipeline.logs.messages.message_blocks import ReadingLedger

MAXIMUM_LINE_BYTES = 1 << 12  # a CAN FD frame of 64 bytes takes some 250
PRINTABLE = re.compile(rb"[\t\r\n\x20-\x7e\x80-\xff]*")


class TextLines:
    """The printable lines of a file, as a file of text; the others are counted as damage.

    Attributes:
        is_lost: Whether a line is damaged though it is text.
        number: Number of the last line that was read.
        offset: Where it starts in the file.
    """

    def __init__(
        self, file: BufferedReader, ledger: ReadingLedger, is_lost: Callable[[str], bool] | None = None
    ) -> None:
        self.file = file
        self.ledger = ledger
        self.is_lost = is_lost
        self.number = self.offset = self.following = 0
        self.repeated: list[str] = []
        self.n_damaged = 0
        self.first_damage: tuple[int, str] | None = None

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        """Return the next printable line."""
        if self.repeated:
            return self.repeated.pop()
        while line := self.file.readline(MAXIMUM_LINE_BYTES):
            self.offset, self.following = self.following, self.following + len(line)
            self.number += 1
            if PRINTABLE.fullmatch(line) and (len(line) < MAXIMUM_LINE_BYTES or line.endswith(b"\n")):
                text = line.decode("latin-1")
                if self.is_lost is None or not self.is_lost(text):
                    return text
                self.damaged("is not read")
            else:
                self.damaged("is not text")
        raise StopIteration

    def repeat(self, line: str) -> None:
        """Return a line before the next one of the file."""
        self.repeated.append(line)

    def damaged(self, reason: str) -> None:
        """Count the last line as damaged."""
        self.n_damaged += 1
        if self.first_damage is None:
            self.first_damage = self.offset, f"line {self.number} {reason}"

    def close(self) -> None:
        """Note the damage; the file is closed by whoever opened it."""
        if self.first_damage is not None:
            offset, text = self.first_damage
            more = f", and {self.n_damaged - 1} more" if self.n_damaged > 1 else ""
            self.ledger.damage(offset, f"{text}{more}; these lines are lost", self.n_damaged)
            self.first_damage, self.n_damaged = None, 0
