"""Where the three programs keep what they hand on to each other, all below one root."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

CLOSED, OPEN = 0o000, 0o700  # modes of the folder of seals
CASE_FILE = "case.json"  # what a solver may know: the folder of the baseline model, or null


@dataclass(frozen=True)
class Folders:
    """The folders below a root."""

    root: Path

    @property
    def cases(self) -> Path:
        """One folder per case: `nominal`, `measured` and `exam` bags, and `case.json`."""
        return self.root / "cases"

    @property
    def seals(self) -> Path:
        """One truth per case."""
        return self.root / "seals"

    def solutions(self, leaving_out: bool) -> Path:
        """One folder per case: what `close_loop` wrote, its log, and what became of it."""
        return self.root / ("solutions_left_out" if leaving_out else "solutions")

    def learned(self, model: str) -> Path:
        """What was learned of the nominal logs that a baseline model is of; `close_loop` reads and writes it."""
        return self.root / "learned" / f"{Path(model).name}.npz"

    def complete_cases(self) -> list[str]:
        """Names of the cases that were written whole, in order."""
        if not self.cases.is_dir():
            return []
        return sorted(path.parent.name for path in self.cases.glob(f"[!.]*/{CASE_FILE}"))


@contextmanager
def sealed(seals: Path) -> Iterator[None]:
    """No one may enter the folder of seals meanwhile."""
    seals.chmod(CLOSED)
    try:
        yield
    finally:
        seals.chmod(OPEN)


def readable(folder: Path) -> bool:
    """Whether this process can look into a folder; tried, because the superuser's permissions tell nothing."""
    try:
        os.listdir(folder)
    except PermissionError:
        return False
    return True
