"""The examples of what `pipeline` exports, run one after the other on a minute of made-up logs."""

import doctest
import inspect
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from omegaconf import OmegaConf

import pipeline
from pipeline.configuration import load
from pipeline.control import train_policy as training
from pipeline.discrepancy import close_loop as discrepancy
from pipeline.logs.formats.writer import write_bag

ORDER = ("ingest", "read_logs", "identify", "evaluate", "plan", "train_policy", "close_loop")
SHORT = {
    "identify": {
        "evaluation_windows": 4,
        "selected": {"mlp_dqdot": {"hidden": [8], "lags": 2, "horizon": 2, "maximum_epochs": 1}},
    },
    "episodes": {"steps": 8, "table_rows": 256, "evaluation_episodes": 2},
    "icem": {"horizon": 2, "samples": 4, "elites": 2, "iterations": 1},
}
HEAVY = ("mujoco", "brax", "jax", "mlflow", "numba", "scipy")


def write_logs(folder: Path) -> None:
    machine, random = pipeline.load_machine("bobcat_e10"), np.random.default_rng(0)
    stamps = 1_700_000_000_000_000_000 + np.arange(3000, dtype=np.int64) * 25_000_000
    write_bag(
        folder / "morning",
        machine,
        joint_state_header_stamp_ns=stamps,
        joint_state_log_time_ns=stamps + 1_000_000,
        joint_names=machine.joint_names,
        positions=np.array([0.0, 0.5, -1.0, -1.0]) + np.cumsum(random.normal(0, 1e-3, (3000, 4)), axis=0),
        command_log_time_ns=stamps[::5],
        commands=random.integers(-1, 2, (600, 4)).astype(np.int8),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs, and a profile `default` that is done in seconds."""
    folder = tmp_path_factory.mktemp("surface")
    for logs in ("logs", "newer_logs"):
        write_logs(folder / logs)
    shutil.copytree(load.CONFIGURATION_DIRECTORY / "profile", folder / "profile")
    OmegaConf.save(SHORT, folder / "profile/default.yaml")
    return folder


def test_examples_run(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Training and the search have tests of their own; here they are called with what they take."""
    monkeypatch.setattr(load, "CONFIGURATION_DIRECTORY", folder)
    monkeypatch.chdir(folder)
    called: list[object] = []

    def untrained(*arguments: object) -> SimpleNamespace:
        inspect.signature(train).bind(*arguments)
        called.append(train)
        Path("policy").mkdir()
        return SimpleNamespace(save=lambda output: (output / "policy.msgpack").touch())

    def unsearched(*arguments: object, **named: object) -> SimpleNamespace:
        inspect.signature(search).bind(*arguments, **named)
        called.append(search)
        return SimpleNamespace(document={"verdict": "no_difference", "effects": {}})

    train, search = training.train_policy, discrepancy.close_loop
    monkeypatch.setattr(training, "train_policy", untrained)
    monkeypatch.setattr(discrepancy, "close_loop", unsearched)
    names = {name: getattr(pipeline, name) for name in pipeline.__all__}
    names |= {"Path": Path, "machine": pipeline.load_machine("bobcat_e10")}
    runner = doctest.DocTestRunner(verbose=False)
    for name in ORDER:
        test = doctest.DocTestParser().get_doctest(inspect.getdoc(names[name]), names, name, None, None)
        assert test.examples, f"{name} has no example"
        report: list[str] = []
        failures = runner.run(test, out=report.append, clear_globs=False).failed
        assert not failures, "".join(report)
        names |= test.globs
    assert called == [train, search]


def test_every_name_is_there() -> None:
    assert set(ORDER) <= set(pipeline.__all__)
    assert all(inspect.getdoc(getattr(pipeline, name)) for name in pipeline.__all__)
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = pipeline.no_such_name


def test_ingest_waits_for_no_simulator(folder: Path) -> None:
    """Neither the package nor the stage, its page included, imports what only models need."""
    program = (
        "import sys, pipeline, runpy\n"
        "assert 'numpy' not in sys.modules\n"
        "sys.argv = ['ingest', 'logs=logs', 'output=elsewhere', 'tracking=none', 'hydra.run.dir=runs']\n"
        "runpy.run_module('pipeline.stages.ingest', run_name='__main__')\n"
        f"print('imported:', *({{*{HEAVY}}} & set(sys.modules)))"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(pipeline.__file__).parents[1])}
    ended = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, env=environment
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.splitlines()[-1].strip() == "imported:"
    assert (folder / "elsewhere/quality.html").exists()
