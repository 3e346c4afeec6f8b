"""Hashes against DVC's own, and what a run may say that it wrote."""

import subprocess
import sys
from pathlib import Path

import yaml

from pipeline.tracking.lineage import content_hash, dvc_hashes

ROOT = Path(__file__).parents[2]


def test_hashes_are_those_of_the_lock_file(tmp_path: Path) -> None:
    lock = tmp_path / "dvc.lock"
    lock.write_text(
        "schema: '2.0'\nstages:\n  record:\n    cmd: x\n    outs:\n    - path: data/raw/sessions\n      md5: abc.dir\n"
        "  ingest:\n    cmd: y\n    deps:\n    - path: data/raw/sessions\n      md5: before.dir\n"
    )
    assert dvc_hashes(["data/raw/sessions/", "data/other"], lock) == {"data/raw/sessions": "abc.dir"}


def test_contents_are_hashed_as_dvc_hashes_them(tmp_path: Path) -> None:
    for name, content in (("b/z.txt", "1"), ("b/\u00e4.txt", "2"), ("b.txt", "3\r\n"), ("a/c/d.bin", "\0")):
        path = tmp_path / "data" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode())
    (tmp_path / "data/empty").mkdir()
    dvc = Path(sys.executable).with_name("dvc")
    for words in (["init", "--quiet", "--no-scm"], ["add", "--quiet", "data", "--no-commit"]):
        subprocess.run([dvc, *words], cwd=tmp_path, check=True, capture_output=True)
    (folder,) = yaml.safe_load((tmp_path / "data.dvc").read_text())["outs"]
    assert content_hash(tmp_path / "data") == folder["md5"]
    assert content_hash(tmp_path / "nowhere") is None
