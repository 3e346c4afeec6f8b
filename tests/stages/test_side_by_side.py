"""Stages side by side: the order that they start in, and DVC's own records afterwards."""

import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from pipeline.stages.processes.side_by_side import leading_to, read_graph, run_all, to_run

DVC = Path(sys.executable).with_name("dvc")
DIAMOND = {"top": set(), "left": {"top"}, "right": {"top"}, "below": {"left", "right"}, "alone": set()}


def test_dvc_s_graph_is_read_per_file():
    dot = (
        'strict digraph {\n"top";\n"left@a-0";\n"sub/dvc.yaml:top";\n"sub/dvc.yaml:end";\n'
        '"top" -> "left@a-0";\n"sub/dvc.yaml:top" -> "sub/dvc.yaml:end";\n"top" -> "sub/dvc.yaml:end";\n}\n'
    )
    assert read_graph(dot) == {"top": set(), "left@a-0": {"top"}}
    end = {"sub/dvc.yaml:end": {"sub/dvc.yaml:top"}}
    assert read_graph(dot, "sub/dvc.yaml") == {"sub/dvc.yaml:top": set()} | end


def test_what_a_change_reaches_is_run_again():
    assert to_run(DIAMOND, ["left"]) == {"left": set(), "below": {"left"}}
    assert to_run(DIAMOND, []) == {}


def test_what_stages_need_is_told_by_name_and_by_cell():
    above = {"top": set(), "each@a": {"top"}, "each@b": {"top"}, "all": {"each@a", "each@b"}, "alone": set()}
    assert leading_to(above, ["each@a"]) == {"top": set(), "each@a": {"top"}}
    assert set(leading_to(above, ["each", "alone"])) == {"top", "each@a", "each@b", "alone"}


def test_two_run_at_once_and_each_after_what_it_needs():
    done, most, running, lock = [], 0, set(), threading.Lock()

    def run(name):
        nonlocal most
        with lock:
            assert DIAMOND[name] <= set(done)
            running.add(name)
            most = max(most, len(running))
        time.sleep(0.02)
        with lock:
            running.remove(name)
            done.append(name)
        return 0

    assert run_all(DIAMOND, run) == 0
    assert sorted(done) == sorted(DIAMOND) and most == 2


def test_a_failure_ends_the_run_with_its_status():
    started = []

    def run(name):
        started.append(name)
        return 3 if name == "top" else 0

    assert run_all(DIAMOND, run) == 3
    assert set(started) <= {"top", "alone"}


@pytest.mark.long
def test_dvc_finds_nothing_left_to_do(tmp_path):
    """Six stages by DVC itself: its lock file is whole, and a second run starts none."""
    for command in (["git", "init", "-q"], [DVC, "init", "-q"]):
        subprocess.run(command, cwd=tmp_path, check=True)
    (tmp_path / "dvc.yaml").write_text(
        "stages:\n  top: {cmd: echo 1 > top; echo top >> runs, outs: [top]}\n"
        "  each:\n    foreach: [a, b, c, d]\n    do:\n"
        "      {cmd: 'cat top > ${item}; echo ${item} >> runs', deps: [top], outs: ['${item}']}\n"
        "  all: {cmd: 'cat a b c d > all', deps: [a, b, c, d], outs: [all]}\n"
    )
    command = [sys.executable, "-m", "pipeline.stages.processes.side_by_side"]
    environment = {"PATH": f"{DVC.parent}:/usr/bin:/bin", "PYTHONPATH": str(Path(__file__).parents[2])}
    for _ in range(2):
        subprocess.run(command, cwd=tmp_path, check=True, env=environment)
    assert sorted((tmp_path / "runs").read_text().split()) == ["a", "b", "c", "d", "top"]
    assert (tmp_path / "all").read_text() == "1\n" * 4
    status = subprocess.run([DVC, "status"], cwd=tmp_path, check=True, capture_output=True, text=True)
    assert "up to date" in status.stdout
