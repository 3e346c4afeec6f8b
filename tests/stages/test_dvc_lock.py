"""A lock file that DVC was killed at, by DVC's own reading of it."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from dvc.dvcfile import Lockfile
from dvc.exceptions import DvcException
from dvc.repo import Repo
from hypothesis import example, given
from hypothesis import strategies as st

from pipeline.stages.processes.dvc_lock import is_sound, mend

DVC = str(Path(sys.executable).with_name("dvc"))
LOCK = (Path(__file__).resolve().parents[2] / "dvc.lock").read_text()[:4000]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A DVC project in git whose one stage has run, with its lock file committed."""
    folder = tmp_path_factory.mktemp("finished")
    for command in (["git", "init", "-q"], [DVC, "init", "-q"]):
        subprocess.run(command, cwd=folder, check=True)
    (folder / "dvc.yaml").write_text(
        "stages:\n  count:\n    cmd: echo ran >> runs; echo 1 > one\n    outs: [one]\n"
    )
    repro(folder)
    subprocess.run(["git", "add", "-A"], cwd=folder, check=True)
    identity = ["-c", "user.name=a", "-c", "user.email=a@b"]
    subprocess.run(["git", *identity, "commit", "-q", "-m", "all"], cwd=folder, check=True)
    return folder


@pytest.fixture
def project(finished: Path, tmp_path: Path) -> Path:
    """A copy of it, to be damaged."""
    return shutil.copytree(finished, tmp_path / "project", symlinks=True)


def repro(folder: Path) -> subprocess.CompletedProcess[str]:
    """What `make repro` ends with."""
    return subprocess.run([DVC, "repro"], cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.long
@pytest.mark.parametrize("left", ["", "schema: '2.0'\nstages:\n  count:\n    cm"], ids=["nothing", "a part"])
def test_a_torn_lock_file_stops_dvc_and_is_mended(project: Path, left: str) -> None:
    (project / "dvc.lock").write_text(left)
    assert repro(project).returncode != 0
    (line,) = mend(project)
    assert line.startswith("dvc.lock: ") and line.endswith("took the last commit's")
    assert repro(project).returncode == 0
    assert (project / "runs").read_text() == "ran\n"  # the stage's result was not lost
    assert mend(project) == []


def test_without_a_commit_of_it_the_run_cache_knows(project: Path) -> None:
    subprocess.run(["git", "rm", "-q", "--cached", "dvc.lock"], cwd=project, check=True)
    subprocess.run(
        ["git", "-c", "user.name=a", "-c", "user.email=a@b", "commit", "-q", "-m", "no lock"],
        cwd=project,
        check=True,
    )
    (project / "dvc.lock").write_text("")
    (line,) = mend(project)
    assert line.endswith("removed")
    assert repro(project).returncode == 0
    assert (project / "one").read_text() == "1\n"


@pytest.mark.long
def test_a_torn_list_of_users_stops_dvc_and_is_removed(project: Path) -> None:
    (project / ".dvc/tmp/rwlock").write_text('{"read": {')
    (project / "one").unlink()
    assert repro(project).returncode != 0
    (line,) = mend(project)
    assert line.startswith(".dvc/tmp/rwlock: ")
    assert repro(project).returncode == 0


@pytest.fixture(scope="module")
def dvc(tmp_path_factory: pytest.TempPathFactory) -> Repo:
    """DVC itself."""
    return Repo.init(str(tmp_path_factory.mktemp("dvc")), no_scm=True)


@given(content=st.integers(0, len(LOCK)).map(lambda end: LOCK[:end]))
@example(content="schema: '2.0'\nstages:\n  one:\n    cmd: one\n    deps:\n    - path: a\n      md5: 18e4")
def test_what_is_sound_is_what_dvc_reads(content: str, dvc: Repo) -> None:
    path = Path(dvc.root_dir) / "dvc.lock"
    path.write_text(content)
    try:
        Lockfile(dvc, str(path)).load()
        read = True
    except DvcException:
        read = False
    assert is_sound(content) is read
