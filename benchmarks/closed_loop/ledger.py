"""A ledger of solved cases: one line of JSON each, which outlasts the folders that a case was drawn and solved in.

A benchmark of many hours is run in sittings, on machines that begin empty. What a score needs of a case (its truth,
what `close_loop` answered, the errors on the exam logs) is a few thousand characters; bags and models are drawn anew
by their seed if someone wants them. Each line says which code solved the case, so that one table never mixes two.
"""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.closed_loop.comparison import Solution
from benchmarks.closed_loop.truth import Truth, from_content
from pipeline.configuration.load import load_section
from pipeline.discrepancy.diagnosis.nominal.fingerprint import code_fingerprint
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.errors import InputError
from pipeline.files.atomic import write_whole

SECTIONS = {"close_loop": CloseLoopConfig, "identify": IdentifyConfig}


@dataclass(frozen=True)
class Record:
    """A solved case.

    Attributes:
        case: Its name.
        code: Fingerprint of the code that solved it.
        truth: What the seal holds.
        solution: What the run left.
    """

    case: str
    code: str
    truth: Truth
    solution: Solution


def fingerprint() -> str:
    """Of the code and the settings that decide what `close_loop` answers."""
    digest = hashlib.sha256(code_fingerprint().encode())
    for section, schema in SECTIONS.items():
        digest.update(json.dumps(asdict(load_section(section, schema)), sort_keys=True).encode())
    return digest.hexdigest()[:12]


def read(path: Path) -> list[Record]:
    """All records, in the order in which they were added; none where there is no ledger yet.

    Raises:
        InputError: A line is not a record.
    """
    if not path.exists():
        return []
    found = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            found.append(_record(json.loads(line)))
        except (ValueError, TypeError, KeyError) as error:
            raise InputError(
                f"{path}, line {number}: no record of a solved case ({error}); restore the file"
            ) from error
    return found


def add(path: Path, records: Iterable[Record]) -> list[Record]:
    """Write records that the ledger lacks behind those that it has; a case solved again by other code is another."""
    present = read(path)
    known = {(r.case, r.code) for r in present}
    together = present + [r for r in records if (r.case, r.code) not in known]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, "".join(_line(r) for r in together).encode())
    return together


def _line(record: Record) -> str:
    return json.dumps(asdict(record), sort_keys=True) + "\n"


def _record(content: dict[str, Any]) -> Record:
    of = {"truth": from_content(content["truth"]), "solution": Solution(**content["solution"])}
    return Record(**(content | of))
