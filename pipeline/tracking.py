"""Runs in MLflow: one parent run per pipeline run, one child per stage.

All stages that one `dvc repro` starts share a parent. The library knows nothing of this module; stages hand it plain
numbers and files.
"""

import contextlib
import fcntl
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import yaml
from tqdm import tqdm

from pipeline.errors import InputError

PARENT_LOCK = Path("runs/tracking.lock")
DVC_LOCK = Path("dvc.lock")


@dataclass
class TrackingConfiguration:
    """Where runs are tracked: `conf/tracking/*.yaml`."""

    enabled: bool
    uri: str  # of MLflow's tracking store
    artifacts: str | None  # where a new experiment puts its artifacts; None: the server decides
    experiment: str


@dataclass
class StageRun:
    """What one stage reports of its run; without tracking it keeps nothing."""

    name: str
    run_id: str | None = None
    parent_id: str | None = None
    _client: Any = None

    def metrics(self, values: Mapping[str, float], step: int = 0) -> None:
        """Report scalar metrics; nested names are joined by dots already."""
        if self._client is None:
            return
        from mlflow.entities import Metric

        now_ms = int(time.time() * 1000)
        metrics = [
            Metric(key, float(value), now_ms, step) for key, value in values.items() if value is not None
        ]
        self._client.log_batch(self.run_id, metrics=metrics)

    def artifact(self, path: Path, folder: str | None = None) -> None:
        """Attach a file, or a folder with everything in it."""
        if self._client is None:
            return
        if path.is_dir():
            self._client.log_artifacts(self.run_id, str(path), folder or path.name)
        else:
            self._client.log_artifact(self.run_id, str(path), folder)

    def inputs(self, *paths: str | Path) -> None:
        """Tag the run with the DVC hashes of the data it read."""
        if self._client is None:
            return
        for path, digest in dvc_hashes([str(path) for path in paths]).items():
            self._client.set_tag(self.run_id, f"dvc.{path}", digest)

    def model(
        self,
        *,
        code: Path,
        package: Path,
        artifacts: Mapping[str, Path],
        requirements: Sequence[str],
        registered_name: str,
        example: Any,
        name: str = "model",
        alias: str | None = None,
    ) -> None:
        """Log a model from code with its input example, and register it as a new version of `registered_name`.

        Args:
            code: File that MLflow runs to load the model.
            package: Package that it imports; travels with the model.
            artifacts: Files and folders of the model, by the names that the code knows.
            requirements: Packages with versions, for a machine that has none of them.
            registered_name: Name in MLflow's registry.
            example: A table that the model takes.
            name: Of the model in the run.
            alias: Of the new version in the registry, taken from the version that had it.
        """
        if self._client is None:
            return
        import mlflow

        mlflow.set_tracking_uri(self._client.tracking_uri)
        with tempfile.TemporaryDirectory() as folder:
            copied = shutil.copytree(
                package, Path(folder) / package.name, ignore=shutil.ignore_patterns("__pycache__", "stages")
            )
            with mlflow.start_run(run_id=self.run_id):
                logged = mlflow.pyfunc.log_model(
                    name=name,
                    python_model=str(code),
                    code_paths=[str(copied)],
                    artifacts={name: str(path.absolute()) for name, path in artifacts.items()},
                    pip_requirements=list(requirements),
                    registered_model_name=registered_name,
                    input_example=example,
                )
        if alias is not None:
            version = str(logged.registered_model_version)
            self._client.set_registered_model_alias(registered_name, alias, version)

    def parent_metrics(self, values: Mapping[str, float], tags: Mapping[str, str] | None = None) -> None:
        """Report metrics of the whole pipeline on the parent run, so that pipeline runs can be compared."""
        if self._client is None or self.parent_id is None:
            return
        StageRun(self.name, self.parent_id, None, self._client).metrics(values)
        for key, value in (tags or {}).items():
            self._client.set_tag(self.parent_id, key, value)


@contextlib.contextmanager
def track(
    name: str, configuration: TrackingConfiguration, resolved: Mapping[str, Any], configuration_yaml: str
) -> Iterator[StageRun]:
    """Open the run of stage `name`, nested in its pipeline's run; close it whatever happens inside."""
    if not configuration.enabled:
        yield StageRun(name)
        return
    client, experiment_id = _open_store(configuration)
    pipeline = pipeline_identity()
    tags = {
        "mlflow.runName": os.environ.get("DVC_STAGE", name),
        "stage": name,
        "profile": str(resolved.get("profile", "")),
        "machine": str(resolved["machine"]["name"]),
        "process": _process_identity(psutil.Process()),
        **_git_tags(),
    }
    parent_id = _parent_run(client, experiment_id, pipeline, tags, resolved) if pipeline else None
    if parent_id:
        tags["mlflow.parentRunId"] = parent_id
    run = client.create_run(experiment_id, tags=tags)
    run_id = run.info.run_id
    _log_parameters(client, run_id, resolved)
    client.log_text(run_id, configuration_yaml, "configuration.yaml")
    status = "FAILED"
    try:
        yield StageRun(name, run_id, parent_id, client)
        status = "FINISHED"
    except KeyboardInterrupt:
        status = "KILLED"
        raise
    finally:
        client.set_terminated(run_id, status)
        if parent_id:  # no stage is running any more, so neither is the pipeline
            client.set_terminated(parent_id, status)


def pipeline_identity() -> str | None:
    """What tells one pipeline run from another: the `dvc` process that started us, or None outside DVC."""
    if "DVC_STAGE" not in os.environ:
        return None
    for ancestor in psutil.Process().parents():
        with contextlib.suppress(psutil.Error):
            if any(Path(word).name == "dvc" for word in ancestor.cmdline()[:3]):
                return _process_identity(ancestor)
    return None


def dvc_hashes(paths: list[str], lock: Path = DVC_LOCK) -> dict[str, str]:
    """Hashes of `paths` (outputs of earlier stages, relative to the repository) as `dvc.lock` holds them."""
    if not lock.exists():
        return {}
    stages = (yaml.safe_load(lock.read_text()) or {}).get("stages", {})
    # What a stage wrote outdoes what another read before.
    known = {
        entry["path"]: entry.get("md5", "")
        for role in ("deps", "outs")
        for content in stages.values()
        for entry in content.get(role, [])
    }
    return {path: known[path] for path in map(os.path.normpath, paths) if path in known}


def _open_store(configuration: TrackingConfiguration) -> tuple[Any, str]:
    # Processes that create one SQLite database at once crash, so its first opening is serialised.
    with _locked(PARENT_LOCK):
        os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")
        from mlflow import MlflowClient
        from mlflow.exceptions import MlflowException

        try:
            client = MlflowClient(tracking_uri=configuration.uri)
            experiment = client.get_experiment_by_name(configuration.experiment)
            if experiment is not None:
                _end_orphans(client, experiment.experiment_id)
                return client, experiment.experiment_id
            location = Path(configuration.artifacts).absolute().as_uri() if configuration.artifacts else None
            return client, client.create_experiment(configuration.experiment, artifact_location=location)
        except MlflowException as error:
            raise InputError(
                f"tracking.uri={configuration.uri}: {error}; is the tracking server up?"
            ) from error


def _end_orphans(client: Any, experiment_id: str) -> None:
    """End runs whose process was killed before it could."""
    for run in client.search_runs([experiment_id], "attributes.status = 'RUNNING'"):
        process = run.data.tags.get("process")
        if process and not _alive(process):
            client.set_terminated(run.info.run_id, "KILLED")


def _parent_run(
    client: Any, experiment_id: str, pipeline: str, tags: Mapping[str, str], resolved: Mapping[str, Any]
) -> str:
    with _locked(PARENT_LOCK):
        found = client.search_runs([experiment_id], f"tags.pipeline = '{pipeline}'", max_results=1)
        if found:
            client.update_run(found[0].info.run_id, status="RUNNING")
            return found[0].info.run_id
        parent_tags = {
            key: value for key, value in tags.items() if key not in ("stage", "mlflow.runName", "process")
        }
        parent_tags |= {
            "pipeline": pipeline,
            "process": pipeline,
            "mlflow.runName": f"{tags['profile']} {time.strftime('%Y-%m-%d %H:%M:%S')}",
        }
        run_id = client.create_run(experiment_id, tags=parent_tags).info.run_id
        shared = {key: value for key, value in resolved.items() if isinstance(value, Mapping)}
        _log_parameters(client, run_id, shared)  # not the stage's own keys
        return run_id


def _log_parameters(client: Any, run_id: str, resolved: Mapping[str, Any]) -> None:
    from mlflow.entities import Param

    parameters = [Param(key, str(value)) for key, value in _flatten(resolved).items()]
    batch = 100  # MLflow's limit per request
    for start in range(0, len(parameters), batch):
        client.log_batch(run_id, params=parameters[start : start + batch])


def _flatten(tree: Any, prefix: str = "") -> dict[str, Any]:
    if isinstance(tree, Mapping):
        return {
            key: value
            for name, branch in tree.items()
            for key, value in _flatten(branch, f"{prefix}{name}.").items()
        }
    return {prefix.rstrip("."): tree}


def _git_tags() -> dict[str, str]:
    try:
        commit = subprocess.run(
            ["git", "rev-parse", "HEAD"], capture_output=True, text=True, check=True
        ).stdout.strip()
        dirty = subprocess.run(
            ["git", "status", "--porcelain", "--untracked-files=no"],
            capture_output=True,
            text=True,
            check=True,
        ).stdout
    except (OSError, subprocess.CalledProcessError):
        return {}
    return {"mlflow.source.git.commit": commit, "git.dirty": str(bool(dirty)).lower()}


def _process_identity(process: psutil.Process) -> str:
    return f"{process.pid}-{process.create_time():.2f}@{socket.gethostname()}"


def _alive(identity: str) -> bool:
    if not identity.endswith(f"@{socket.gethostname()}"):
        return True  # another computer's; it ends its own
    try:
        return _process_identity(psutil.Process(int(identity.split("-")[0]))) == identity
    except psutil.Error:
        return False


def flatten_metrics(tree: Mapping[str, Any]) -> dict[str, float]:
    """Nested metrics as `a.b.c: number`; what is not a number is left out."""
    return {
        key: float(value)
        for key, value in _flatten(tree).items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }


def progress_bar(description: str, total: int, unit: str) -> tqdm:
    """A progress bar on standard error; in a log file it prints a line every half minute instead of redrawing."""
    interval_s = 0.2 if sys.stderr.isatty() else 30.0
    return tqdm(
        total=total, desc=description, unit=unit, mininterval=interval_s, maxinterval=interval_s, leave=True
    )


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
