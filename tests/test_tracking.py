import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from mlflow import MlflowClient

from pipeline.errors import InputError
from pipeline.tracking import TrackingConfiguration, dvc_hashes, track

RESOLVED = {"profile": "smoke", "machine": {"name": "bobcat_e10", "rate_hz": 20.0}, "seed": 3}


@pytest.fixture
def configuration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TrackingConfiguration:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DVC_STAGE", raising=False)
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
    with track("identify", configuration, RESOLVED, "seed: 3\n") as run:
        run.metrics({"open_loop_rmse_80.boom": 0.25})
        run.artifact(tmp_path / "metrics.json")
    (found,) = runs(configuration)
    assert found.info.status == "FINISHED"
    assert found.data.params["machine.rate_hz"] == "20.0"
    assert found.data.metrics == {"open_loop_rmse_80.boom": 0.25}
    client = MlflowClient(tracking_uri=configuration.uri)
    assert {item.path for item in client.list_artifacts(found.info.run_id)} == {
        "configuration.yaml",
        "metrics.json",
    }


def test_a_failing_stage_leaves_a_failed_run(configuration: TrackingConfiguration) -> None:
    with pytest.raises(InputError), track("ingest", configuration, RESOLVED, "") as _:
        raise InputError("no such folder")
    (found,) = runs(configuration)
    assert found.info.status == "FAILED"


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
    root = str(Path(__file__).parents[1])
    environment = os.environ | {"DVC_STAGE": "identify@mlp-dqdot", "PYTHONPATH": root}
    # fields hold a relative-free URI, so the folder in which the stages run does not matter
    subprocess.run([sys.executable, str(dvc)], check=True, cwd=tmp_path, env=environment)
    found = runs(configuration)
    parents = [run for run in found if "pipeline" in run.data.tags]
    children = [run for run in found if "mlflow.parentRunId" in run.data.tags]
    assert len(parents) == 1 and len(children) == 2
    assert {run.data.tags["mlflow.parentRunId"] for run in children} == {parents[0].info.run_id}
    assert {run.info.status for run in found} == {"FINISHED"}
    assert parents[0].data.metrics == {"success": 1.0}
    assert parents[0].data.params == {"machine.name": "bobcat_e10", "machine.rate_hz": "20.0"}


def test_hashes_are_those_of_the_lock_file(tmp_path: Path) -> None:
    lock = tmp_path / "dvc.lock"
    lock.write_text(
        "schema: '2.0'\nstages:\n  record:\n    cmd: x\n    outs:\n    - path: data/raw/sessions\n      md5: abc.dir\n"
        "  ingest:\n    cmd: y\n    deps:\n    - path: data/raw/sessions\n      md5: before.dir\n"
    )
    assert dvc_hashes(["data/raw/sessions/", "data/other"], lock) == {"data/raw/sessions": "abc.dir"}
