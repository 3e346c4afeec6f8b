"""Open the seals and score what was solved: the full table, goals, confusion, worst cases.

python -m benchmarks.closed_loop.score [ROOT] [--ledger FILE] [--json FILE] [--markdown FILE] [--kinds …]
    [--simulator NAME …]
"""

import argparse
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.closed_loop import kinds
from benchmarks.closed_loop.comparison import FAILED, Outcome, Solution, compare
from benchmarks.closed_loop.folders import Folders, readable
from benchmarks.closed_loop.goals import figures, of_stated_size
from benchmarks.closed_loop.ledger import Record, add, fingerprint
from benchmarks.closed_loop.machines import variant_name
from benchmarks.closed_loop.sessions import MACHINE
from benchmarks.closed_loop.simulators import KINDS, SIMULATORS
from benchmarks.closed_loop.tables import case_table, confusion_table, family_table, goals_table, worst_table
from benchmarks.closed_loop.truth import Truth, from_json
from pipeline.configuration.load import load_machine
from pipeline.files.atomic import write_whole


def read_solution(folder: Path) -> Solution | None:
    """What a run left; None where the case was not run yet."""
    run = _json(folder / "run.json")
    if run is None:
        return None
    answer = _json(folder / "closed_loop.json") if run["status"] == 0 else None
    return Solution(run["status"], run["seconds"], answer, _json(folder / "exam.json"))


def records(folders: Folders) -> list[Record]:
    """All cases that were solved below a root, with and without their true card."""
    found = []
    for left_out in (False, True):
        for name in folders.complete_cases():
            folder = folders.solutions(left_out) / name
            solution = read_solution(folder)
            if solution is not None:
                truth = from_json((folders.seals / f"{name}.json").read_text())
                # what is in the nominal logs too has a baseline, and so a floor, of its own
                floor = None if truth.kind == kinds.IN_NOMINAL else _floor(folders, truth)
                code = _json(folder / "run.json").get("code", "unknown")
                found.append(Record(name, left_out, code, truth, solution, floor))
    return found


def outcomes(solved: Sequence[Record], leaving_out: bool) -> list[Outcome]:
    """Solved cases, scored."""
    return [compare(r.case, r.truth, r.solution, r.floor) for r in solved if r.is_left_out == leaving_out]


def _floor(folders: Folders, truth: Truth) -> Mapping[str, float] | None:
    content = _json(
        folders.root / "yardsticks" / f"{variant_name(SIMULATORS[truth.simulator], truth.variant)}.json"
    )
    if content is None:
        return None
    return dict(zip(load_machine(MACHINE).joint_names, content["open_loop_rmse_80"], strict=True))


def _json(path: Path) -> Any:
    return json.loads(path.read_text()) if path.exists() else None


def report(code: str, chosen: list[Outcome], left_out: list[Outcome]) -> str:
    """The whole score as Markdown."""
    n_failed = sum(o.verdict == FAILED for o in chosen)
    stated = figures([o for o in chosen if of_stated_size(o)], [o for o in left_out if of_stated_size(o)])
    parts = [
        f"{len(chosen)} cases solved by code {code}, {n_failed} of them failed runs (they count as not detected); "
        f"{len(left_out)} cases with the true card deleted. {simulators_line([*chosen, *left_out])}",
        "## Goals",
        goals_table(figures(chosen, left_out), stated),
        "## By kind",
        family_table(chosen),
        "## Confusion: truth in rows, named first in columns",
        confusion_table(chosen),
        "## Worst cases",
        worst_table(chosen),
        "## All cases",
        "Joints: right/wrong/missed. Parameter error: median of the case's numbers.",
        case_table(chosen),
    ]
    if left_out:
        parts += ["## True card deleted", confusion_table(left_out), case_table(left_out)]
    return "\n\n".join(parts) + "\n"


def simulators_line(scored: Sequence[Outcome]) -> str:
    """From which simulators cases come, in words."""
    counts = Counter(outcome.truth.simulator for outcome in scored)
    listed = [f"{counts[name]} from {name}" for name in SIMULATORS if counts[name]]
    return f"Simulators: {', '.join(listed) or 'none'}."


def main() -> None:
    parser = argparse.ArgumentParser(prog="score", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("root", type=Path, nargs="?", help="where cases were solved in this sitting")
    parser.add_argument("--ledger", type=Path, help="add them to this ledger, and score all that it holds")
    parser.add_argument(
        "--code", help="only cases solved by the code of this fingerprint (default: this code)"
    )
    parser.add_argument("--json", type=Path, help="also write all outcomes and figures here")
    parser.add_argument("--markdown", type=Path, help="also write the tables here")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS, metavar="KIND")
    parser.add_argument(
        "--simulator",
        nargs="+",
        choices=SIMULATORS,
        default=tuple(SIMULATORS),
        help="default: all",
        metavar="NAME",
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
    solved = [
        r
        for r in solved
        if r.code == code and r.truth.kind in arguments.kinds and r.truth.simulator in arguments.simulator
    ]
    chosen, left_out = (outcomes(solved, leaving_out) for leaving_out in (False, True))
    text = report(code, chosen, left_out)
    print(text)
    if arguments.markdown:
        write_whole(arguments.markdown, text.encode())
    if arguments.json:
        content = {
            "figures": [asdict(figure) for figure in figures(chosen, left_out)],
            "cases": [asdict(outcome) for outcome in chosen],
            "left_out": [asdict(outcome) for outcome in left_out],
        }
        write_whole(arguments.json, (json.dumps(content, indent=1) + "\n").encode())


if __name__ == "__main__":
    main()
