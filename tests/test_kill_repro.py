"""The kill test's own parts: it kills what it started, and finds what it is to find."""

import hashlib
import random
import sys
from pathlib import Path

import pytest
import yaml

from benchmarks import kill_repro


@pytest.mark.long
def test_a_command_is_killed_as_often_as_asked_and_then_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The command starts another one, as `dvc` does; both write when they begin, and when they end."""
    monkeypatch.setattr(kill_repro, "STARTING_S", 0.5)
    (tmp_path / "killed").mkdir()
    child = "import time; note('child begins'); time.sleep(1.5); note('child ends')"
    note = "note = lambda word: open('notes', 'a').write(word + chr(10))"
    parent = (
        f"{note}; import subprocess, sys; subprocess.run([sys.executable, '-c', sys.argv[1]]); note('end')"
    )
    command = [sys.executable, "-c", parent, f"{note}; {child}"]
    hit = kill_repro.kill_and_start_again(tmp_path / "killed", command, 2, 0.3, random.Random(1))
    notes = (tmp_path / "killed/notes").read_text().split("\n")
    assert hit == ["between stages"] * 2
    assert notes.count("end") == 1 and notes.count("child ends") == 1  # no killed one's child went on


def test_outputs_that_are_not_what_the_lock_file_says_are_found(tmp_path: Path) -> None:
    for name in ("whole", "torn", "missing"):
        (tmp_path / name).write_text(name)
    outs = [
        {"path": name, "md5": hashlib.md5(name.encode()).hexdigest()} for name in ("whole", "torn", "missing")
    ]
    (tmp_path / "dvc.lock").write_text(yaml.safe_dump({"stages": {"identify": {"outs": outs}}}))
    assert kill_repro.corrupt_outputs(tmp_path) == []
    (tmp_path / "torn").write_text("to")
    (tmp_path / "missing").unlink()
    assert kill_repro.corrupt_outputs(tmp_path) == [
        "torn of identify is not what dvc.lock says",
        "missing of identify is not what dvc.lock says",
    ]


def test_lost_and_changed_trials_are_found(tmp_path: Path) -> None:
    rows = {
        "undisturbed": ["0,0.5,1.0", "1,0.4,2.0"],
        "same": ["0,0.5,9.0", "1,0.4,9.0"],
        "lost": ["0,0.5,1.0"],
    }
    for name, lines in rows.items():
        table = tmp_path / name / "artifacts/search/mlp_dqdot/trials.csv"
        table.parent.mkdir(parents=True)
        table.write_text("\n".join(["trial,evaluation_loss,seconds", *lines]))
    undisturbed = tmp_path / "undisturbed"
    assert kill_repro.different_trials(undisturbed, tmp_path / "same", 2) == []
    assert kill_repro.different_trials(undisturbed, tmp_path / "lost", 2) == [
        "1 trials instead of 2",
        "the trials came to other results",
    ]
