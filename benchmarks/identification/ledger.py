"""The ledger: one line of JSON for each fitted model, so that a run goes on where it ended."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

from pipeline.errors import InputError


@dataclass(frozen=True)
class Row:
    """One model of one kind, and its errors by joint, rad (m where joints are prismatic).

    Attributes:
        machine: Its name; `<machine>/<log>` where that log of a folder is held out.
        minutes: Of logs that it was identified from; NaN is not used, replays have 0.
        seed: Of the training.
        kind: As in `kinds.py`; `floor` for replays.
        errors: By horizon in steps.
        coverage: By steps ahead, `covered` and `width` of the 90 % band; empty without one.
        training_s: Processor time of the fit, compilation included.
    """

    machine: str
    minutes: float
    seed: int
    kind: str
    errors: dict[str, list[float]]
    coverage: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    training_s: float = 0.0

    @property
    def key(self) -> tuple[str, float, int, str]:
        """What a row is known by: of two with one key, the later counts."""
        return self.machine, self.minutes, self.seed, self.kind


def read(path: Path) -> dict[tuple[str, float, int, str], Row]:
    """All rows; none where there is no ledger yet. An unfinished last line is left out.

    Raises:
        InputError: Another line is not a row.
    """
    if not path.exists():
        return {}
    rows: dict[tuple[str, float, int, str], Row] = {}
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    for number, line in enumerate(lines, start=1):
        try:
            row = Row(**json.loads(line))
        except (ValueError, TypeError) as error:
            if number == len(lines) and not line.endswith("\n"):
                break
            raise InputError(
                f"{path}, line {number}: not a row of a ledger ({error}); remove the line"
            ) from error
        rows[row.key] = row
    return rows


def add(path: Path, row: Row) -> None:
    """Append a row, behind an unfinished line on a line of its own."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab+") as file:
        if file.tell():
            file.seek(-1, 2)
            if file.read() != b"\n":
                file.seek(0)
                whole = file.read()
                file.truncate(whole.rfind(b"\n") + 1)
        file.write((json.dumps(asdict(row), sort_keys=True) + "\n").encode())
