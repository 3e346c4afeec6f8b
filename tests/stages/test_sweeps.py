"""Sweeps (`-m`) as a user runs them: one process, several, and through the engine that submits to Slurm."""

import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra

from pipeline.deployment.components.recording import Recorder
from pipeline.stages import run_graph
from tests.stages.command import run_stage

ROOT = Path(__file__).parents[2]
LAUNCHERS = {
    "basic": [],
    "joblib": ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2"],
    "submitit": ["hydra/launcher=submitit_local"],
}
LONG = {"joblib", "submitit"}  # start processes that import the libraries


def sweep(folder: Path, *overrides: str) -> subprocess.CompletedProcess[str]:
    """A sweep over documents of which the stage `unseal` says that there is nothing to judge: it starts fastest.

    Launchers that start processes run in one of their own: submitit closes the streams of the process that it is in.
    """
    (folder / "first.json").write_text(json.dumps({"note": "nothing measured"}))
    words = ["-m", "output=judged/${closed_loop}", *overrides]
    if any(override.startswith("hydra/launcher=") for override in overrides):
        command = [sys.executable, "-m", "pipeline.stages.unseal", *words, "tracking=none"]
        return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    return run_stage("unseal", *words, folder=folder)


def test_no_job_starts_before_all_are_checked(tmp_path: Path) -> None:
    result = sweep(tmp_path, "closed_loop=first.json", "tracking.system_metrics_interval_s=1,-1")
    assert result.returncode == 2
    assert result.stderr.splitlines() == [
        "error: unseal: tracking.system_metrics_interval_s is -1.0; it must be positive, or null"
    ]
    assert "Launching" not in result.stdout
    assert not (tmp_path / "judged").exists()


@pytest.mark.parametrize(
    "launcher", [pytest.param(name, marks=pytest.mark.long if name in LONG else []) for name in LAUNCHERS]
)
def test_a_failing_job_leaves_the_others_running_and_is_told(launcher: str, tmp_path: Path) -> None:
    result = sweep(tmp_path, "closed_loop=nowhere.json,first.json", *LAUNCHERS[launcher])
    assert result.returncode == 2
    assert "note" in json.loads((tmp_path / "judged/first.json").read_text())
    told = [line for line in result.stderr.splitlines() if not line.startswith("[")]
    assert len(told) == 2 and "closed_loop=nowhere.json" in told[0]  # Hydra's line says which job
    assert told[1] == "error: unseal: nowhere.json: no such file; run close_loop first"


def test_slurm_queues_a_job_again_that_ran_out_of_time() -> None:
    importlib.import_module("pipeline.stages.unseal")  # registers its schema
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        composed = compose("unseal", ["hydra/launcher=slurm"], return_hydra_config=True)
    launcher = composed.hydra.launcher
    assert launcher._target_.endswith("submitit_launcher.SlurmLauncher")
    assert launcher.max_num_timeout > 0 and launcher.timeout_min > 60


def test_each_job_of_a_sweep_joins_a_graph_of_its_own_with_its_own_overrides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []

    def apart(function: object, *_: object) -> tuple:
        assert function is run_graph.run_targets
        return [], Recorder()

    monkeypatch.setattr("pipeline.configuration.own_process.in_own_process", apart)
    monkeypatch.setattr(run_graph, "settings_of", lambda _, keys: seen.append([keys.targets]) or keys)
    monkeypatch.setattr(run_graph, "node_commands", lambda _, overrides: seen[-1].append(overrides))
    for name in ("write_run", "simulate_targets", "write_bag_of"):
        monkeypatch.setattr(run_graph, name, lambda *_: None)
    monkeypatch.setattr(run_graph, "trials_of", lambda *_: [])
    output = "output='out (${targets})/${hydra:job.num}'"
    result = run_stage("run_graph", "-m", "model=a", "policy=b", "targets=1,2", output, folder=tmp_path)
    assert result.returncode == 0, result.stderr
    assert seen == [
        [n + 1, ["model=a", "policy=b", f"targets={n + 1}", f"output='out ({n + 1})/{n}'", "tracking=none"]]
        for n in range(2)
    ]
