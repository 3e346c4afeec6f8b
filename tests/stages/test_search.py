"""The commands search and select as a user runs them: workers killed, resumed, and sharing a real PostgreSQL."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import optuna
import pytest
import yaml
from optuna.storages import BaseStorage
from optuna.trial import TrialState

from pipeline.configuration.load import load_machine, load_section
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.search.search_space import Choose
from pipeline.dynamics.settings import TrainingConfig
from pipeline.dynamics.training import fit as fit_module
from pipeline.dynamics.training.data_split import split_by_purpose
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory, write_tuples
from pipeline.machine.specification import JointSpecification, MachineSpecification
from pipeline.study.configuration import SearchConfig
from pipeline.study.search import KindStudy, SearchedKind, TrialTraining
from pipeline.study.settings import Pruner
from pipeline.study.storage import open_storage
from pipeline.study.trials import TrialOutcome
from pipeline.study.worker import DivergedError, Study

from ..dynamics.conftest import lag_trajectory, make_identify, make_training
from ..postgresql import postgresql_server
from ..study_worker import settings as study_settings
from .command import run_stage

ROOT = Path(__file__).parents[2]
START_UP_TIMEOUT_S = 120
SEARCHED = "artifacts/search/mlp_dqdot/trials.csv"
SMALL = (
    "profile=smoke",
    "tuples=tuples",
    "identify.evaluation_horizon=10",
    "identify.evaluation_windows=8",
    "identify.checkpoint_every_epochs=1",
    "search.study.heartbeat_s=0.5",
    "search.study.stale_after_s=60",
    "search.spaces.mlp={lags: [2, 3], learning_rate: [1e-3, 1e-2], batch_size: [32, 64], horizon: [3], "
    "layers: [1], units: [4, 8], maximum_epochs: 12}",
)


@pytest.fixture(scope="module")
def tuples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short log of joints that follow their commands."""
    folder = tmp_path_factory.mktemp("tuples")
    random, n_rows = np.random.default_rng(0), 500
    machine = load_machine("bobcat_e10")
    a = np.repeat(random.integers(-1, 2, (n_rows // 10, 4)), 10, axis=0).astype(float)
    qd = np.zeros((n_rows, 4))
    for t in range(n_rows - 1):
        qd[t + 1] = qd[t] + 0.2 * (0.1 * a[t] - qd[t])
    t_s = np.arange(n_rows) / machine.rate_hz
    write_tuples(
        folder / "log.parquet",
        machine,
        [
            Trajectory(
                name="log",
                t_s=t_s,
                stamp_ns=(1e9 * t_s).astype(np.int64),
                q=(machine.lower + machine.upper) / 2 + np.cumsum(qd, axis=0) / machine.rate_hz,
                qd=qd,
                a=a,
                is_validation=np.arange(n_rows) >= 360,
            )
        ],
    )
    return folder


@pytest.fixture
def folder(tuples: Path, tmp_path: Path) -> Path:
    """A folder to work in, with the tuples in it."""
    (tmp_path / "tuples").symlink_to(tuples)
    return tmp_path


def start(
    stage: str, *overrides: str, folder: Path, environment: dict[str, str] | None = None
) -> subprocess.Popen:
    command = [sys.executable, "-m", f"pipeline.stages.{stage}", *overrides]
    if not any(override.startswith("tracking") for override in overrides):
        command.append("tracking=none")
    variables = os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    return subprocess.Popen(
        command,
        cwd=folder,
        env=variables | (environment or {}),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def run(stage: str, *overrides: str, folder: Path) -> str:
    end = run_stage(stage, *overrides, folder=folder)
    assert end.returncode == 0, end.stderr[-1000:]
    return end.stdout


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def attempts(storage: BaseStorage) -> list[optuna.trial.FrozenTrial]:
    studies = storage.get_all_studies()
    return storage.get_all_trials(studies[0]._study_id) if studies else []


def wait_until(condition, workers: list[subprocess.Popen]) -> None:
    deadline_s = time.monotonic() + START_UP_TIMEOUT_S
    while not condition():
        assert time.monotonic() < deadline_s, "the workers did not start in time"
        for worker in workers:
            assert worker.poll() is None, worker.stderr.read()
        time.sleep(0.02)


def is_training(attempt: optuna.trial.FrozenTrial, worker: subprocess.Popen) -> bool:
    """Whether the worker runs the attempt, and has done so long enough to have a heartbeat."""
    return (
        attempt.state is TrialState.RUNNING
        and attempt.user_attrs.get("worker", "").startswith(f"{worker.pid}-")
        and attempt.user_attrs.get("seconds", 0.0) > 0
    )


@pytest.fixture(scope="module")
def resumed(empty_store: Path, tuples: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a search that was killed within its third trial and started again, and one that was not."""
    folder = tmp_path_factory.mktemp("resumed")
    shutil.copy(empty_store, folder / "mlflow.db")
    (folder / "tuples").symlink_to(tuples)
    run("search", *SMALL, "n_trials=4", "storage=whole.journal", "output=whole", folder=folder)
    store = (
        "tracking=sqlite",
        f"tracking.uri=sqlite:///{folder}/mlflow.db",
        f"tracking.artifacts={folder}/runs",
    )
    killed = (*SMALL, "n_trials=4", "storage=killed.journal", *store)
    worker = start("search", *killed, folder=folder)
    wait_until((folder / "killed.journal").exists, [worker])

    def is_within_third_trial() -> bool:
        now = attempts(open_storage(str(folder / "killed.journal")))
        return len(now) >= 3 and any(is_training(attempt, worker) for attempt in now)

    wait_until(is_within_third_trial, [worker])
    worker.kill()
    worker.communicate()
    (folder / "before.journal").write_bytes((folder / "killed.journal").read_bytes())
    again = start("search", *killed, folder=folder)
    _, errors = again.communicate(timeout=300)
    assert again.returncode == 0, errors[-1000:]
    return folder


@pytest.mark.slow
@pytest.mark.long
def test_a_killed_search_resumes_to_the_table_that_it_would_have_written(resumed: Path) -> None:
    before = attempts(open_storage(str(resumed / "before.journal")))
    after = attempts(open_storage(str(resumed / "killed.journal")))
    for old, new in zip(before, after, strict=False):  # nothing finished was touched again
        if old.state.is_finished():
            assert (new.state, new.value, new.datetime_complete) == (
                old.state,
                old.value,
                old.datetime_complete,
            )
    assert Counter(attempt.state for attempt in after) == {TrialState.COMPLETE: 4, TrialState.FAIL: 1}
    assert sum(int(row["attempts"]) for row in table(resumed / SEARCHED)) == 5

    def results(path: Path) -> list[dict[str, str]]:
        return [
            {key: cell for key, cell in row.items() if key not in ("seconds", "attempts")}
            for row in table(path)
        ]

    assert results(resumed / SEARCHED) == results(resumed / "whole/trials.csv")
    assert not list((resumed / "checkpoints").rglob("trial_*"))


@pytest.mark.long
def test_of_all_workers_one_reports_the_study(resumed: Path) -> None:
    from mlflow import MlflowClient

    client = MlflowClient(f"sqlite:///{resumed}/mlflow.db")
    runs = client.search_runs([experiment.experiment_id for experiment in client.search_experiments()])
    tables = [client.list_artifacts(run.info.run_id, "search") for run in runs]
    assert len(runs) == 2  # the killed process, and the one that finished
    ((reporting, files),) = ((run, files) for run, files in zip(runs, tables, strict=True) if files)
    assert {file.path for file in files} == {"search/meta.json", "search/trials.csv"}
    smallest = min(float(row["evaluation_loss"]) for row in table(resumed / SEARCHED))
    assert reporting.data.metrics["trials"] == 4
    assert reporting.data.metrics["smallest_evaluation_loss"] == smallest


@pytest.mark.long
def test_a_search_ends_in_a_model_that_identify_trains_to_the_same_result(resumed: Path) -> None:
    rows = table(resumed / SEARCHED)
    output = run("select", "profile=smoke", "search.selection.margin=0", folder=resumed)
    smallest = min(rows, key=lambda row: float(row["evaluation_loss"]))
    selection = json.loads((resumed / "artifacts/select/mlp_dqdot.json").read_text())
    assert selection["selected"]["trial"] == int(smallest["trial"])
    assert selection["selected"]["step_time"]["median_s"] > 0
    assert "MLP(512, 128)" in output and "5.675e-03" in output  # the paper's beside ours
    for name in ("selected_models.md", "selected_models.csv", "selected_models.tex"):
        assert (resumed / "artifacts/select" / name).stat().st_size > 0
    selected = yaml.safe_load((resumed / "artifacts/select/selected.yaml").read_text())["selected"]
    overrides = [f"identify.selected.mlp_dqdot.{key}={value}" for key, value in selected["mlp_dqdot"].items()]
    identified = [override for override in SMALL if not override.startswith("search")]
    run("identify", *identified, *overrides, "output=model", folder=resumed)
    metrics = json.loads((resumed / "model/metrics.json").read_text())
    assert metrics["evaluation_loss"] == float(smallest["evaluation_loss"])
    assert metrics["n_parameters"] == int(smallest["n_parameters"])


@pytest.mark.long
def test_four_workers_share_a_postgresql_though_one_is_killed(folder: Path) -> None:
    n_trials = 6
    with postgresql_server() as environment:
        command = (*SMALL, f"n_trials={n_trials}", "storage=postgresql:///postgres")
        workers = [start("search", *command, folder=folder, environment=environment) for _ in range(4)]
        host = environment["PGHOST"]
        victim: list[subprocess.Popen] = []
        storage: list[BaseStorage] = []

        def one_trains() -> bool:
            if not storage:
                storage.append(open_storage(f"postgresql://search@/postgres?host={host}"))
            now = attempts(storage[0])
            victim[:] = [worker for worker in workers if any(is_training(attempt, worker) for attempt in now)]
            return bool(victim)

        wait_until(one_trains, workers)
        victim[0].kill()
        for worker in workers:
            _, errors = worker.communicate(timeout=300)
            assert worker.returncode == (-signal.SIGKILL if worker is victim[0] else 0), errors[-1000:]
        tried = attempts(storage[0])
        storage[0].engine.dispose()
    complete = [attempt for attempt in tried if attempt.state is TrialState.COMPLETE]
    died = [attempt for attempt in tried if "reason" not in attempt.user_attrs and attempt not in complete]
    assert len({attempt.number for attempt in tried}) == len(tried)
    assert len(complete) == n_trials
    assert [attempt.state for attempt in died] == [TrialState.FAIL]
    assert died[0].user_attrs["worker"].startswith(f"{victim[0].pid}-")
    assert any(attempt.params == died[0].params for attempt in complete)
    assert len({attempt.user_attrs["worker"] for attempt in complete}) >= 2
    rows = table(folder / SEARCHED)
    assert [int(row["trial"]) for row in rows] == list(range(n_trials))
    assert min(float(row["evaluation_loss"]) for row in rows) == min(attempt.value for attempt in complete)


def test_a_password_goes_nowhere(folder: Path) -> None:
    end = run_stage("search", "storage=postgresql://me:secret@host/db", "tracking=sqlite", folder=folder)
    assert end.returncode == 2
    (line,) = end.stderr.splitlines()
    assert line.startswith("error: search: storage=postgresql://me:***@host/db: this would be")
    assert not (folder / "mlflow.db").exists()


def test_nothing_to_select_from_is_one_line(folder: Path) -> None:
    end = run_stage("select", "profile=smoke", "searched=nowhere", folder=folder)
    assert end.returncode == 2
    (line,) = end.stderr.splitlines()
    assert line.startswith("error: select: searched=nowhere: no folder KIND/trials.csv")


def test_what_is_held_out_is_not_searched_on(tuples: Path) -> None:
    def learning(hold_out: list[str]) -> list[Trajectory]:
        return split_by_purpose(tuples, None, hold_out, load_machine("bobcat_e10")).learning

    assert [trajectory.name for trajectory in learning([])] == ["log"]
    with pytest.raises(InputError, match="no such trajectory"):
        learning(["mine"])
    with pytest.raises(InputError, match="nothing is left"):
        learning(["log"])


def test_a_total_below_one_is_refused(tmp_path: Path) -> None:
    searched = small_search([lag_trajectory(0, n_rows=300, n_validation=80)])
    study = KindStudy(searched, str(tmp_path / "a.journal"), tmp_path / "checkpoints")
    with pytest.raises(InputError, match="n_trials is 0"):
        study.run(0, lambda _: None, lambda *_: None)


def small_search(trajectories: list[Trajectory], **changes: Any) -> SearchedKind:
    machine = MachineSpecification(
        name="two_joints",
        rate_hz=20.0,
        joints=[JointSpecification("lift", -1.0, 1.0), JointSpecification("turn", -1.0, 1.0)],
    )
    search = load_section("search", SearchConfig)
    kind = Parameterization.mlp, Target.dqdot
    return SearchedKind(machine, make_identify(**changes), search, *kind, trajectories)


@pytest.mark.long
def test_a_pruned_training_closes_and_a_retry_would_go_on_from_it(tmp_path: Path) -> None:
    log = [lag_trajectory(0, n_rows=300, n_validation=80)]
    trainer = TrialTraining(small_search(log), tmp_path / "checkpoints")
    settings = study_settings(pruner=Pruner.median, startup_trials=1)
    study: Study[TrainingConfig] = Study(str(tmp_path / "a.journal"), "study", settings, 6)

    def propose(choose: Choose) -> TrainingConfig:
        rate = choose("learning_rate", [3e-3, 1e-7])
        return make_training(hidden=[4], learning_rate=rate, maximum_epochs=6)

    study.run(8, propose, trainer)
    by_rate = {
        rate: {trial.outcome for trial in study.trials() if trial.parameters["learning_rate"] == rate}
        for rate in (3e-3, 1e-7)
    }
    assert by_rate[3e-3] == {TrialOutcome.complete}
    assert TrialOutcome.pruned in by_rate[1e-7]
    pruned = next(trial for trial in study.trials() if trial.outcome is TrialOutcome.pruned)
    epochs: list[int] = []
    went_on = SimpleNamespace(
        number=pruned.number, report=lambda epoch, evaluation_loss: epochs.append(epoch)
    )
    trainer(make_training(hidden=[4], learning_rate=1e-7, maximum_epochs=6), went_on)
    last = int(pruned.reason.split()[-1])
    assert epochs == list(range(last, 7))  # the checkpoint is that of the epoch before


@pytest.mark.parametrize("fails_at", ["first epoch", "evaluation"])
def test_a_diverging_training_is_a_divergence(
    fails_at: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = [lag_trajectory(0, n_rows=300, n_validation=80)]
    rate = {"first epoch": 1e30, "evaluation": 1e-3}[fails_at]
    if fails_at == "evaluation":  # finite in training, not over the longer horizon
        monkeypatch.setattr(fit_module, "compile_evaluation", lambda *_: lambda *_: np.float32(np.inf))
    trial = SimpleNamespace(number=0, report=lambda epoch, evaluation_loss: None)
    with pytest.raises(DivergedError, match="no finite L"):
        TrialTraining(small_search(log), tmp_path)(make_training(hidden=[4], learning_rate=rate), trial)
