"""Open the seals and score what was solved: goals per simulator, ROC, where misses are lost, confusion, all cases.

python -m benchmarks.closed_loop.score [ROOT] [--ledger FILE] [--code CODE] [--json FILE] [--markdown FILE]
    [--simulator NAME …]
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.closed_loop.comparison import FAILED, Outcome, Solution, compare
from benchmarks.closed_loop.folders import Folders, readable
from benchmarks.closed_loop.ledger import Record, add, fingerprint
from benchmarks.closed_loop.simulators import SIMULATORS
from benchmarks.closed_loop.tables import (
    by_simulator,
    case_table,
    confusion_table,
    family_table,
    goals_table,
    lost_table,
    roc_table,
)
from benchmarks.closed_loop.truth import from_json
from pipeline.files.atomic import write_whole


def read_solution(folder: Path) -> Solution | None:
    """What a run left; None where the case was not run yet."""
    run = _json(folder / "run.json")
    if run is None:
        return None
    answer = _json(folder / "closed_loop.json") if run["status"] == 0 else None
    return Solution(run["status"], run["seconds"], answer, _json(folder / "exam.json"))


def records(folders: Folders) -> list[Record]:
    """All cases that were solved below a root."""
    found = []
    for name in folders.complete_cases():
        folder = folders.solutions / name
        solution = read_solution(folder)
        if solution is not None:
            truth = from_json((folders.seals / f"{name}.json").read_text())
            found.append(Record(name, _json(folder / "run.json").get("code", "unknown"), truth, solution))
    return found


def outcomes(solved: Sequence[Record]) -> list[Outcome]:
    """Solved cases, scored."""
    return [compare(r.case, r.truth, r.solution) for r in solved]


def _json(path: Path) -> Any:
    return json.loads(path.read_text()) if path.exists() else None


def report(code: str, scored: Sequence[Outcome]) -> str:
    """The whole score as Markdown."""
    n_failed = sum(o.verdict == FAILED for o in scored)
    parts = [
        f"{len(scored)} cases solved by code {code}, {n_failed} of them failed runs, which count as not detected. "
        "Intervals are 95 %, over machines. **Bold** figures miss the goal.",
        "## Goals, over effects above the visible size",
        goals_table(scored, only_visible=True),
        "## Goals, over all effects",
        goals_table(scored, only_visible=False),
        "## Detection at shares of false alarms, over effects above the visible size",
        roc_table(scored, only_visible=True),
        "## Where effects are lost",
        lost_table(scored),
    ]
    for name, part in by_simulator(scored).items():
        parts += [f"## {name}: by kind", family_table(part)]
        parts += [f"## {name}: truth in rows, named first in columns", confusion_table(part)]
    parts += ["## All cases", "Times visible: the size over the visible one.", case_table(scored)]
    return "\n\n".join(parts) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(prog="score", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("root", type=Path, nargs="?", help="where cases were solved in this sitting")
    parser.add_argument("--ledger", type=Path, help="add them to this ledger, and score all that it holds")
    parser.add_argument(
        "--code", help="only cases solved by the code of this fingerprint (default: this code)"
    )
    parser.add_argument("--json", type=Path, help="also write all outcomes here")
    parser.add_argument("--markdown", type=Path, help="also write the tables here")
    parser.add_argument(
        "--simulator", nargs="+", choices=SIMULATORS, default=tuple(SIMULATORS), metavar="NAME"
    )
    arguments = parser.parse_args()
    if arguments.root is None and arguments.ledger is None:
        parser.error("nothing to score: name a root, a ledger or both")
    solved: list[Record] = []
    if arguments.root is not None:
        folders = Folders(arguments.root.resolve())
        if not readable(folders.seals):
            parser.error(f"{folders.seals} is closed: a solve is running, or was killed (then: chmod 700)")
        solved = records(folders)
    if arguments.ledger is not None:
        solved = add(arguments.ledger, solved)
    code = arguments.code or fingerprint()
    chosen = [r for r in solved if r.code == code and r.truth.simulator in arguments.simulator]
    scored = outcomes(chosen)
    text = report(code, scored)
    print(text)
    if arguments.markdown:
        write_whole(arguments.markdown, text.encode())
    if arguments.json:
        content = json.dumps([asdict(outcome) for outcome in scored], indent=1) + "\n"
        write_whole(arguments.json, content.encode())


if __name__ == "__main__":
    main()
