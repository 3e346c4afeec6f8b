"""Every job of a sweep joins a graph of its own, with overrides of its own."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipeline.deployment.components.recording import Recorder
from pipeline.errors import InputError
from pipeline.stages import run_graph
from pipeline.stages.processes.own_process import in_own_process
from tests.stages.command import run_stage

PATIENCE_S = 60.0


def refuse(said: str) -> None:
    raise InputError(said)


def test_what_it_returns_or_raises_comes_back() -> None:
    assert in_own_process(os.getpid) != os.getpid()
    with pytest.raises(InputError, match="no master came up"):
        in_own_process(refuse, "no master came up")


def test_it_dies_with_the_command_that_was_killed() -> None:
    work = "import os, time; print(os.getpid(), flush=True); time.sleep(1000)"
    code = f"from pipeline.stages.processes.own_process import in_own_process; in_own_process(exec, {work!r})"
    command = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert command.stdout is not None
    worker = Path(f"/proc/{int(command.stdout.readline())}")
    assert worker.exists()
    command.kill()
    command.wait()
    deadline = time.monotonic() + PATIENCE_S
    while worker.exists() and "Z" not in (worker / "stat").read_text().rpartition(")")[2]:
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.slow
def test_each_job_of_a_sweep_runs_apart_with_its_own_overrides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []

    def apart(function: object, configuration: run_graph.RunGraphStage, overrides: list[str]) -> tuple:
        assert function is run_graph.run_targets
        seen.append((configuration.targets, overrides))
        return [], Recorder()

    monkeypatch.setattr("pipeline.stages.processes.own_process.in_own_process", apart)
    for name in ("write_run", "simulate", "write_bag_of"):
        monkeypatch.setattr(run_graph, name, lambda *_: None)
    monkeypatch.setattr(run_graph, "trials_of", lambda *_: [])
    output = "output='out (${targets})/${hydra:job.num}'"
    result = run_stage("run_graph", "-m", "model=a", "policy=b", "targets=1,2", output, folder=tmp_path)
    assert result.returncode == 0, result.stderr
    assert seen == [
        (n + 1, ["model=a", "policy=b", f"targets={n + 1}", f"output='out ({n + 1})/{n}'", "tracking=none"])
        for n in range(2)
    ]
