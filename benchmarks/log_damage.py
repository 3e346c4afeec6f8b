"""What damage to a log costs: the page docs/log_damage.md, made from the list of the tests' damage cases.

    python -m benchmarks.log_damage > docs/log_damage.md

Each case is made anew and ingested. A row of the page's table says how many of the log's messages were recovered and
what the user is told. `tests/logs/formats/test_damage.py` compares every row with what the ingest does.
"""

import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from tests.logs.damage import CASES
from tests.logs.damage.case import DamageCase, Damaged
from tests.logs.damage.outcome import Outcome, outcomes
from tests.logs.samples.whole_logs import whole_log

HEADINGS = ("damage", "format", "messages", "recovered", "the line given")
MAXIMUM_LINE = 200
INTRODUCTION = """\
<!-- generated: python -m benchmarks.log_damage -->
# Damage to logs

Every case of damage that the tests make, with what the [ingest](logs.md) recovers and the line that it gives.
Messages are joint samples and commands; a row of a table counts as one of each. Of several lines the first is shown.
"""


def page(rows: Sequence[str]) -> str:
    """docs/log_damage.md with these rows."""
    table = [f"| {' | '.join(HEADINGS)} |", "|---" * len(HEADINGS) + "|", *rows]
    return INTRODUCTION + "\n" + "\n".join(table) + "\n"


def row(case: DamageCase, damaged: Damaged, outcome: Outcome, folder: Path) -> str:
    """One line of the table: the first line that was given, and how many more there were."""
    n_whole = damaged.n_whole or whole_log(case.kind).n_messages
    first = outcome.lines[0] if outcome.lines else "none" if outcome.recovered == n_whole else "NONE"
    told = "".join(letter if letter.isprintable() else "�" for letter in first.replace(f"{folder}/", ""))
    told = told[:MAXIMUM_LINE] + ("…" if len(told) > MAXIMUM_LINE else "")
    more = f" (and {len(outcome.lines) - 1} more)" if len(outcome.lines) > 1 else ""
    cells = (case.name, case.kind, f"{n_whole}", f"{outcome.recovered}", told.replace("|", r"\|") + more)
    return f"| {' | '.join(cells)} |"


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        built = []
        for number, case in enumerate(CASES):
            folder = Path(name) / str(number)
            folder.mkdir()
            built.append((case, case.build(folder), folder / "output"))
        found = outcomes(built)
        rows = [
            row(case, damaged, outcome, output.parent)
            for (case, damaged, output), outcome in zip(built, found, strict=True)
        ]
        print(page(rows), end="")
        tracebacks = sum(outcome.status not in (0, 2) for outcome in found)
        print(f"{len(CASES)} cases, {tracebacks} tracebacks or deaths", file=sys.stderr)
        for place, folders, _ in os.walk(name):
            for folder_name in folders:
                if not (Path(place) / folder_name).is_symlink():
                    (Path(place) / folder_name).chmod(0o755)  # or nobody but root could remove it


if __name__ == "__main__":
    main()
