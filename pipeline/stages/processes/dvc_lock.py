"""What DVC needs to start again after it was killed: `python -m pipeline.stages.processes.dvc_lock`, in its folder.

DVC writes `dvc.lock` and its list of who uses which file in place. Killed in that moment it leaves a part of them, and
refuses to read it. The lock file of the last commit then takes its place, or none: results of stages that have run
since are found in DVC's run cache, by the hashes of what they read. The list is of commands that run now.
"""

import json
import subprocess
from pathlib import Path

from dvc.exceptions import DvcException
from dvc.schema import COMPILED_LOCKFILE_SCHEMA
from dvc.utils.serialize import YAMLFileCorruptedError, parse_yaml
from dvc.utils.strictyaml import validate

from pipeline.files.atomic import write_whole

LOCK = Path("dvc.lock")
USERS = Path(".dvc/tmp/rwlock")


def is_sound(lock: str) -> bool:
    """Whether DVC reads a lock file of this content."""
    try:
        # By DVC's own parser, of YAML 1.2: to one of YAML 1.1 the hash `18e4`, cut off there, is text, not a number.
        validate(parse_yaml(lock, str(LOCK)), COMPILED_LOCKFILE_SCHEMA)
    except (YAMLFileCorruptedError, DvcException):
        return False
    return True


def mend(folder: Path = Path()) -> list[str]:
    """Replace what DVC cannot read, and say so.

    Args:
        folder: Root of the DVC project; no command of DVC may be running there.
    """
    said = []
    lock, users = folder / LOCK, folder / USERS
    if lock.exists() and not is_sound(lock.read_text(errors="replace")):
        committed = subprocess.run(
            ["git", "show", f"HEAD:./{LOCK}"], cwd=folder, capture_output=True, check=False
        ).stdout
        if committed and is_sound(committed.decode(errors="replace")):
            write_whole(lock, committed)
            said.append(f"{LOCK}: DVC was killed as it wrote it; took the last commit's")
        else:
            lock.unlink()
            said.append(f"{LOCK}: DVC was killed as it wrote it; removed")
    if users.exists():
        try:
            json.loads(users.read_text())
        except ValueError:
            users.unlink()
            said.append(f"{USERS}: DVC was killed as it wrote it; removed")
    return said


if __name__ == "__main__":
    for line in mend():
        print(line)
