"""The seal is opened, and says whether the closed loop's verdict is right."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pipeline.errors import InputError
from pipeline.plant.sealed.seal import open_seal
from pipeline.plant.sealed.verdict_judgement import judge_verdict

SESSIONS = "sessions"  # beside the seal: the bags that it is about


def unseal(closed_loop: Path, seal: Path, measured: str | None) -> dict[str, Any]:
    """Judge a verdict by the truth; of a user's own logs nobody knows it, which a `note` then says.

    Args:
        closed_loop: `closed_loop.json`.
        seal: What was switched on in the simulated machine.
        measured: The folder of logs that the verdict is from; None: those that the seal lies beside.

    Raises:
        InputError: A file is missing, or is not what `close_loop` writes.
    """
    document = read_document(closed_loop)
    if measured is not None and Path(measured).resolve() != (seal.parent / SESSIONS).resolve():
        return {"note": f"the logs in {measured} are your own: there is no seal to open"}
    if "verdict" not in document:
        return {"note": "the loop was not closed: there is nothing to judge"}
    truth = open_seal(seal)
    try:
        return asdict(judge_verdict(truth, document))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{closed_loop}: is not what close_loop writes ({type(error).__name__}: {error}); run it again"
        ) from error


def read_document(path: Path) -> dict[str, Any]:
    """Read `closed_loop.json`.

    Raises:
        InputError: It is missing or no such document.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; run close_loop first") from error
    except ValueError as error:
        raise InputError(f"{path}: not JSON ({error}); run close_loop again") from error
    if not isinstance(document, dict) or not {"verdict", "note"} & set(document):
        raise InputError(f"{path}: is not what close_loop writes; run it again")
    return document
