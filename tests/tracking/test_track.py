import contextlib
import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from mlflow import MlflowClient

from pipeline.configuration.load import load_section
from pipeline.control.reward_ablation import RewardAblationConfig, cells
from pipeline.errors import InputError
from pipeline.tracking import StageRun, TrackingConfiguration, track
from pipeline.tracking.__main__ import runs_of

ROOT = Path(__file__).parents[2]
RESOLVED = {"profile": "smoke", "machine": {"name": "bobcat_e10", "rate_hz": 20.0}, "seed": 3}


@pytest.fixture
def configuration(
    empty_store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> TrackingConfiguration:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DVC_STAGE", raising=False)
    shutil.copy(empty_store, tmp_path / "mlflow.db")
    return TrackingConfiguration(
        True, f"sqlite:///{tmp_path}/mlflow.db", str(tmp_path / "artifacts"), "reaching"
    )


def runs(configuration: TrackingConfiguration) -> list:
    client = MlflowClient(tracking_uri=configuration.uri)
    experiment = client.get_experiment_by_name(configuration.experiment)
    return client.search_runs([experiment.experiment_id])


def test_a_stage_leaves_a_run_with_parameters_metrics_and_artifacts(
    configuration: TrackingConfiguration, tmp_path: Path
) -> None:
    (tmp_path / "metrics.json").write_text("{}")
    resolved = {**RESOLVED, "close_loop": {"seed": 0}}  # which this stage does not read
    with track("identify", configuration, resolved, "seed: 3\n", unread=["close_loop"]) as run:
        run.metrics({"open_loop_rmse_80.boom": 0.25})
        run.artifact(tmp_path / "metrics.json")
    (found,) = runs(configuration)
    assert found.info.status == "FINISHED"
    assert found.data.params == {
        "profile": "smoke", "machine.name": "bobcat_e10", "machine.rate_hz": "20.0", "seed": "3",
    }  # fmt: skip
    assert found.data.metrics == {"open_loop_rmse_80.boom": 0.25}
    client = MlflowClient(tracking_uri=configuration.uri)
    assert {item.path for item in client.list_artifacts(found.info.run_id)} == {
        "configuration.yaml",
        "metrics.json",
    }


def test_names_of_an_ablation_s_metrics_are_taken(configuration: TrackingConfiguration) -> None:
    ablation = load_section("reward_ablation", RewardAblationConfig, "paper")
    names = {f"{cell.name}/sr_004_004" for cell in cells(ablation)}
    assert len(names) == len(ablation.rows) * len(ablation.seeds)
    with track("reward_ablation", configuration, RESOLVED, "") as run:
        run.metrics(dict.fromkeys(names, 0.5))
    (found,) = runs(configuration)
    assert set(found.data.metrics) == names


def test_a_failing_stage_leaves_a_failed_run(configuration: TrackingConfiguration) -> None:
    with pytest.raises(InputError), track("ingest", configuration, RESOLVED, "") as _:
        raise InputError("no such folder")
    (found,) = runs(configuration)
    assert found.info.status == "FAILED"


@pytest.mark.long
def test_a_killed_stage_is_ended_by_the_next(configuration: TrackingConfiguration) -> None:
    script = (
        "import os, signal, sys, json\n"
        "from pipeline.tracking import TrackingConfiguration, track\n"
        "with track('ppo', TrackingConfiguration(*json.loads(sys.argv[1])), json.loads(sys.argv[2]), ''):\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    fields = [configuration.enabled, configuration.uri, configuration.artifacts, configuration.experiment]
    subprocess.run([sys.executable, "-c", script, json.dumps(fields), json.dumps(RESOLVED)], check=False)
    assert [run.info.status for run in runs(configuration)] == ["RUNNING"]
    with track("report", configuration, RESOLVED, ""):
        pass
    assert sorted(run.info.status for run in runs(configuration)) == ["FINISHED", "KILLED"]


@pytest.mark.long
def test_stages_of_one_dvc_process_share_a_parent(
    configuration: TrackingConfiguration, tmp_path: Path
) -> None:
    """A real process named `dvc` starts two stages one after the other."""
    stage = (
        "import json, sys\n"
        "from pipeline.tracking import TrackingConfiguration, track\n"
        "with track('stage', TrackingConfiguration(*json.loads(sys.argv[1])), json.loads(sys.argv[2]), '') as run:\n"
        "    run.parent_metrics({'success': 1.0})\n"
    )
    fields = [configuration.enabled, configuration.uri, configuration.artifacts, configuration.experiment]
    (tmp_path / "stage.py").write_text(stage)
    dvc = tmp_path / "dvc"
    dvc.write_text(
        "import subprocess, sys\n"
        "for _ in range(2):\n"
        f"    arguments = [{json.dumps(fields)!r}, {json.dumps(RESOLVED)!r}]\n"
        "    subprocess.run([sys.executable, 'stage.py', *arguments], check=True)\n"
    )
    environment = os.environ | {"DVC_STAGE": "identify@mlp-dqdot", "PYTHONPATH": str(ROOT)}
    # fields hold a relative-free URI, so the folder in which the stages run does not matter
    subprocess.run([sys.executable, str(dvc)], check=True, cwd=tmp_path, env=environment)
    found = runs(configuration)
    parents = [run for run in found if "group" in run.data.tags]
    children = [run for run in found if "mlflow.parentRunId" in run.data.tags]
    assert len(parents) == 1 and len(children) == 2
    assert {run.data.tags["mlflow.parentRunId"] for run in children} == {parents[0].info.run_id}
    assert {run.info.status for run in found} == {"FINISHED"}
    assert parents[0].data.metrics == {"success": 1.0}
    assert parents[0].data.params == {"machine.name": "bobcat_e10", "machine.rate_hz": "20.0"}


def start_in_sweep(
    configuration: TrackingConfiguration, job: str
) -> contextlib.AbstractContextManager[StageRun]:
    return track(
        "identify", configuration, {**RESOLVED, "output": f"out/{job}"}, "", ("/runs/multirun_1", job)
    )


def test_jobs_of_a_sweep_share_a_parent_that_lasts_as_long_as_they_do(
    configuration: TrackingConfiguration,
) -> None:
    with start_in_sweep(configuration, "model=mlp"):
        with pytest.raises(InputError), start_in_sweep(configuration, "model=kan"):
            raise InputError("no such folder")
        assert sorted(run.info.status for run in runs(configuration)) == ["FAILED", "RUNNING", "RUNNING"]
    by_name = {run.info.run_name: run for run in runs(configuration)}
    (parent,) = (run for name, run in by_name.items() if name.startswith("identify sweep "))
    assert by_name["identify model=mlp"].info.status == "FINISHED"
    assert by_name["identify model=kan"].info.status == "FAILED"
    assert parent.info.status == "FAILED"
    for name in ("identify model=mlp", "identify model=kan"):
        assert by_name[name].data.tags["mlflow.parentRunId"] == parent.info.run_id


def test_a_stage_taken_up_on_another_computer_ends_the_killed_run(
    configuration: TrackingConfiguration,
) -> None:
    client = MlflowClient(tracking_uri=configuration.uri)
    experiment = client.create_experiment(configuration.experiment, artifact_location=configuration.artifacts)
    places = {"here": "policy", "elsewhere": "other"}
    for name, place in places.items():
        tags = {"mlflow.runName": name, "process": "12-34.56@node7", "writes": str(Path(place).absolute())}
        client.create_run(experiment, tags=tags)
    with track("ppo", configuration, {**RESOLVED, "output": "policy"}, ""):
        pass
    statuses = {run.info.run_name: run.info.status for run in runs(configuration)}
    assert statuses == {"here": "KILLED", "elsewhere": "RUNNING", "ppo": "FINISHED"}


def test_each_question_has_an_experiment(configuration: TrackingConfiguration) -> None:
    configuration = replace(configuration, experiment=None)
    for stage in ("identify", "judge", "evaluate_brax"):
        with track(stage, configuration, RESOLVED, ""):
            pass
    client = MlflowClient(tracking_uri=configuration.uri)
    stages = {
        experiment.name: [run.data.tags["stage"] for run in client.search_runs([experiment.experiment_id])]
        for experiment in client.search_experiments()
    }
    assert stages == {"Default": [], "models": ["judge", "identify"], "controllers": ["evaluate_brax"]}
    text = client.get_experiment_by_name("models").tags["mlflow.note.content"]
    assert text == "Which model predicts the machine best?"


def test_a_run_says_what_it_was_made_of_and_with(
    configuration: TrackingConfiguration, tmp_path: Path
) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data/a.csv").write_text("1")
    old = tmp_path / "out/of_another_stage.json"
    old.parent.mkdir()
    old.write_text("{}")
    os.utime(old, (1, 1))
    with track("ingest", configuration, {**RESOLVED, "output": "out"}, "") as run:
        run.inputs("data", "nowhere")
        (tmp_path / "out/model.bin").write_text("2")
    (found,) = runs(configuration)
    tags = found.data.tags
    md5 = {content: hashlib.md5(content.encode()).hexdigest() for content in "12"}
    listing = json.dumps([{"md5": md5["1"], "relpath": "a.csv"}])
    folder = hashlib.md5(listing.encode()).hexdigest() + ".dir"
    assert tags["input.data"] == folder and tags["output.out/model.bin"] == md5["2"]
    assert {key for key in tags if key.startswith("output.")} == {"output.out", "output.out/model.bin"}
    (data_set,) = found.inputs.dataset_inputs
    assert (data_set.dataset.name, data_set.dataset.digest) == ("data", folder)
    assert tags["environment.python"] == platform.python_version()
    assert tags["environment.lock"] == hashlib.md5((ROOT / "requirements.lock").read_bytes()).hexdigest()
    assert len(tags["mlflow.source.git.commit"]) == 40
    wrote = runs_of("out/model.bin", configuration.uri)
    assert len(wrote) == 1 and wrote[0].startswith(f"wrote  {found.info.run_id}  reaching: ingest")
    (tmp_path / "out/model.bin").write_text("3")  # is no longer what the run wrote
    assert "no run wrote or read it" in runs_of("out/model.bin", configuration.uri)[0]


def test_parts_that_are_compared_have_runs_of_their_own(configuration: TrackingConfiguration) -> None:
    with track("close_loop", configuration, RESOLVED, "") as run:
        for part, error in (("before", 0.2), ("after", 0.1)):
            with run.nested(part) as nested:
                nested.metrics({"model.open_loop_rmse_80.boom": error})
    found = {one.info.run_name: one for one in runs(configuration)}
    assert {found[part].data.metrics["model.open_loop_rmse_80.boom"] for part in ("before", "after")} == {
        0.2,
        0.1,
    }
    assert found["after"].data.tags["mlflow.parentRunId"] == found["close_loop"].info.run_id


def test_the_machine_is_sampled_meanwhile(configuration: TrackingConfiguration) -> None:
    with track("ppo", replace(configuration, system_metrics_interval_s=0.2), RESOLVED, ""):
        time.sleep(1.0)
    (found,) = runs(configuration)
    assert found.data.metrics["system/system_memory_usage_megabytes"] > 0
    with pytest.raises(InputError, match="system_metrics_interval_s is 0"):
        replace(configuration, system_metrics_interval_s=0)


@pytest.mark.long
def test_a_kill_while_the_database_is_made_leaves_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    uri = f"sqlite:///{tmp_path}/mlflow.db"
    script = (
        "import sys\nfrom pipeline.tracking.store import open_store\n"
        "from pipeline.tracking import TrackingConfiguration\n"
        "open_store(TrackingConfiguration(True, sys.argv[1], None, None))\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script, uri], env=os.environ | {"PYTHONPATH": str(ROOT)}
    )
    while process.poll() is None and not list(tmp_path.glob(".mlflow.db.*.partial")):
        time.sleep(0.01)
    process.kill()
    process.wait()
    assert not (tmp_path / "mlflow.db").exists()
    with track("ingest", TrackingConfiguration(True, uri, None, None), RESOLVED, ""):
        pass
    assert (tmp_path / "mlflow.db").exists() and not list(tmp_path.glob(".*.partial"))
