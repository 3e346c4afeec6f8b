"""Lineage of a run: DVC's hashes of inputs and outputs, the code's commit, the environment."""

import hashlib
import json
import os
import platform
import subprocess
from collections.abc import Iterator
from pathlib import Path

import yaml

from pipeline.tracking.project_root import CODE

DVC_LOCK = Path("dvc.lock")
ENVIRONMENT_LOCK = "requirements.lock"
CHUNK_BYTES = 1 << 20


def dvc_hashes(paths: list[str], lock: Path = DVC_LOCK) -> dict[str, str]:
    """Hashes of `paths` (outputs of earlier stages, relative to the repository) as `dvc.lock` holds them."""
    if not lock.exists():
        return {}
    stages = (yaml.safe_load(lock.read_text()) or {}).get("stages", {})
    # The hash of an output replaces the hash that another stage read earlier.
    known = {
        entry["path"]: entry.get("md5", "")
        for role in ("deps", "outs")
        for content in stages.values()
        for entry in content.get(role, [])
    }
    return {path: known[path] for path in map(os.path.normpath, paths) if path in known}


def content_hash(path: Path) -> str | None:
    """Hash of a file or folder as DVC 3 computes it for `dvc.lock`; None if the path is missing.

    For a file it is the MD5 of its bytes. For a folder it is the MD5 of the JSON list of its files' hashes, sorted by
    name, with the suffix `.dir`.
    """
    if path.is_file():
        digest = hashlib.md5(usedforsecurity=False)
        with path.open("rb") as file:
            while chunk := file.read(CHUNK_BYTES):
                digest.update(chunk)
        return digest.hexdigest()
    if not path.is_dir():
        return None
    entries = [
        {"md5": content_hash(file), "relpath": file.relative_to(path).as_posix()} for file in files_in(path)
    ]
    listing = json.dumps(sorted(entries, key=lambda entry: entry["relpath"] or ""), sort_keys=True)
    return f"{hashlib.md5(listing.encode(), usedforsecurity=False).hexdigest()}.dir"


def files_in(folder: Path) -> Iterator[Path]:
    """All files below a folder, links followed."""
    for place, _, names in os.walk(folder, followlinks=True):
        yield from (file for name in names if (file := Path(place) / name).is_file())


def written_since(output: Path, start_s: float) -> dict[str, str]:
    """Hashes of `output` and, for a folder, of each entry, if written since a time (s since the epoch).

    Entries without a newer file belong to other stages.
    """
    paths = [output, *sorted(output.iterdir())] if output.is_dir() else [output]
    return {
        str(path): digest
        for path in paths
        if path.exists() and _newest_s(path) >= start_s and (digest := content_hash(path)) is not None
    }


def _newest_s(path: Path) -> float:
    return max((file.stat().st_mtime for file in (files_in(path) if path.is_dir() else [path])), default=0.0)


def code_tags() -> dict[str, str]:
    """Commit of the code, and whether files under git have changed since; empty without git."""
    try:
        commit, changed = (
            subprocess.run(
                ["git", *words], cwd=CODE, capture_output=True, text=True, check=True
            ).stdout.strip()
            for words in (("rev-parse", "HEAD"), ("status", "--porcelain", "--untracked-files=no"))
        )
    except (OSError, subprocess.CalledProcessError):
        return {}
    return {"mlflow.source.git.commit": commit, "git.dirty": str(bool(changed)).lower()}


def environment_tags() -> dict[str, str]:
    """Interpreter, platform, and the hash of the lock file that the environment is built from."""
    lock = content_hash(CODE / ENVIRONMENT_LOCK)
    return {
        "environment.python": platform.python_version(),
        "environment.platform": platform.platform(),
        **({"environment.lock": lock} if lock else {}),
    }
