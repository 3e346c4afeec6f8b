"""Sealed files: the plant's switched-on effects, protected from accidental reading until the last check."""

import base64
import hashlib
import json
import zlib
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from pipeline.errors import InputError
from pipeline.plant.effects.effect import PlantEffect

HEADING = (
    "Sealed record of what was switched on in the simulated machine. Only the report's final check opens it."
)
READ_ONLY = 0o400
WIDTH = 100  # characters per line of the sealed text


def contents(effects: Sequence[PlantEffect]) -> list[dict]:
    """The sealed content of each effect: all but its code."""
    return [
        {
            "family": effect.family,
            "kind": effect.kind,
            "joints": list(effect.joints),
            "depends_on": list(effect.depends_on),
            "parameters": {name: asdict(quantity) for name, quantity in effect.truth.items()},
            "cause": effect.cause,
            "onset_s": effect.onset_s,
        }
        for effect in effects
    ]


def write_seal(path: Path, effects: Sequence[PlantEffect]) -> None:
    """Write the truth about `effects` (none: a null case) to `path`, readable by its owner only.

    An older seal at `path` is replaced. The same effects give the same bytes.
    """
    text = json.dumps({"effects": contents(effects)}, sort_keys=True).encode()
    sealed = base64.b64encode(zlib.compress(text, 9)).decode()
    lines = [sealed[i : i + WIDTH] for i in range(0, len(sealed), WIDTH)]
    path.unlink(missing_ok=True)
    path.write_text("\n".join([HEADING, f"sha256 {hashlib.sha256(text).hexdigest()}", *lines, ""]))
    path.chmod(READ_ONLY)


def open_seal(path: Path) -> list[dict]:
    """The effects that a seal holds, as `contents` gave them.

    Raises:
        InputError: the file is absent, is not a seal, or was changed since it was written.
    """
    try:
        heading, checksum, *lines = path.read_text().splitlines()
        text = zlib.decompress(base64.b64decode("".join(lines), validate=True))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); record the logs again") from error
    except (ValueError, zlib.error) as error:
        raise InputError(f"{path}: is not a seal or is damaged; record the logs again") from error
    if heading != HEADING or checksum != f"sha256 {hashlib.sha256(text).hexdigest()}":
        raise InputError(f"{path}: the seal's checksum does not fit its content; record the logs again")
    return json.loads(text)["effects"]
