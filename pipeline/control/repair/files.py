"""A repair's folder: the former policy, the new one, and `repair.json`, which says whether the new one is better."""

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

from pipeline.control.policy import META_FILE, POLICY_FILE, Policy, load_policy, load_policy_of
from pipeline.control.repair.comparison import Comparison
from pipeline.control.repair.repair import Repaired
from pipeline.errors import InputError
from pipeline.files.atomic import write_json

DOCUMENT, FORMER, NEW = "repair.json", "former", "policy"
ON_MODEL, ON_MACHINE = "on_model", "on_machine"  # what trials there say; null before them
DECIDED = {"promotable", "reason"}
WRITTEN = {*DECIDED, "margin", "machine", ON_MACHINE}


def write_repair(folder: Path, repaired: Repaired, policy: Path, margin: float) -> dict[str, Any]:
    """Write the folder of a repair of the policy in `policy`, and return the document."""
    (folder / FORMER).mkdir(parents=True, exist_ok=True)
    for name in (POLICY_FILE, META_FILE):
        shutil.copyfile(policy / name, folder / FORMER / name)
    repaired.save(folder / NEW)
    on_model = repaired.comparison.as_dict(margin)
    document = {
        **on_model,
        "margin": margin,
        "effects_known_exactly": repaired.is_certain,
        "machine": repaired.lineage["machine"],
        "policies": {name: _digest(folder / name) for name in (FORMER, NEW)},
        ON_MODEL: on_model,
        ON_MACHINE: None,
    }
    write_json(folder / DOCUMENT, document, allow_nan=False)
    return document


def write_note(folder: Path, note: str) -> str:
    """Say in place of a repair why there is none."""
    write_json(folder / DOCUMENT, {"note": note})
    return note


def note_in(folder: Path) -> str | None:
    """Why there is no repair in a folder of one; None where there is one, or no file."""
    try:
        return json.loads((folder / DOCUMENT).read_text(encoding="utf-8")).get("note")
    except (OSError, ValueError, AttributeError):
        return None


def add_machine_trials(folder: Path, comparison: Comparison) -> tuple[dict[str, Any], str]:
    """Write what both policies did on the machine into the document; both gates count.

    Returns:
        What was written, and in one line what it shows.

    Raises:
        InputError: See `read_repair`.
    """
    document = read_repair(folder)
    on_machine = comparison.as_dict(document["margin"])
    document[ON_MACHINE] = on_machine
    document["promotable"] = document[ON_MODEL]["promotable"] and on_machine["promotable"]
    document["reason"] = f"on the model {document[ON_MODEL]['reason']}; on the machine {on_machine['reason']}"
    write_json(folder / DOCUMENT, document, allow_nan=False)
    success = (f"{100 * on_machine[name]:.1f} %" for name in ("sr_before", "sr_after"))
    told = f"success {' to '.join(success)} over {comparison.n_targets} targets; {document['reason']}"
    return on_machine, told


def read_repair(folder: Path) -> dict[str, Any]:
    """The document of a repair whose policies are as they were compared.

    Raises:
        InputError: There is none, it is damaged, or a policy is another one.
    """
    path = folder / DOCUMENT
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        if "note" in document:
            raise InputError(
                f"{path}: there is no repair: {document['note']}; repair on a model with effects"
            )
        policies = document["policies"]
        changed = [name for name in (FORMER, NEW) if policies[name] != _digest(folder / name)]
        for part, keys in ((document, WRITTEN), (document[ON_MODEL], DECIDED)):
            if missing := keys - set(part):
                raise ValueError(f"no {', '.join(sorted(missing))}")
    except FileNotFoundError as error:
        raise InputError(f"{error.filename}: no such file; name a folder that repair wrote") from None
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: not readable as a repair ({error}); repair the policy again") from None
    if changed:
        raise InputError(f"{folder / changed[0]}: not the policy that was compared; repair it again")
    return document


def read_policies(folder: Path, model: Path, machine: str) -> dict[str, Policy]:
    """The machine's former policy and its new one, learned on `model`, by the names of their folders.

    Raises:
        InputError: See `read_repair` and `load_policy_of`.
    """
    read_repair(folder)
    former, _ = load_policy(folder / FORMER, machine)
    return {FORMER: former, NEW: load_policy_of(folder / NEW, model, machine)}


def _digest(folder: Path) -> str:
    return hashlib.sha256((folder / POLICY_FILE).read_bytes()).hexdigest()
