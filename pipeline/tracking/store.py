"""MLflow's tracking store: opening it, parent runs, and closing runs whose process was killed."""

import contextlib
import fcntl
import os
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import InputError
from pipeline.files.atomic import PARTIAL_SUFFIX, atomic_path
from pipeline.tracking import processes
from pipeline.tracking.configuration import SQLITE, TrackingConfiguration
from pipeline.tracking.experiments import Question
from pipeline.tracking.metrics import flatten
from pipeline.tracking.project_root import project_folder
from pipeline.tracking.store_check import check_database, short_timeouts

LOCK = "runs/tracking.lock"  # in the project's folder; beside a SQLite file, its name with LOCK_SUFFIX
LOCK_SUFFIX = ".lock"
PARENT = "mlflow.parentRunId"  # MLflow's own tag for nested runs
PARAMETERS_PER_REQUEST = 100  # MLflow's limit
# A parent gets the worst status of its children.
STATUSES = ("FAILED", "KILLED", "FINISHED")


@dataclass(frozen=True)
class RunGroup:
    """A group of runs: those of one `dvc repro`, or of one sweep.

    Attributes:
        identity: Unique among all groups.
        title: Name of its parent run, before the time.
        process: Process that starts the runs; None if no process lives as long as the group.
    """

    identity: str
    title: str
    process: str | None


@contextlib.contextmanager
def locked(uri: str) -> Iterator[None]:
    """Exclude the project's other processes from the store."""
    is_file = uri.startswith(SQLITE)
    path = Path(uri.removeprefix(SQLITE) + LOCK_SUFFIX) if is_file else project_folder() / LOCK
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def open_store(configuration: TrackingConfiguration) -> Any:
    """A client of the tracking store.

    Raises:
        InputError: The store does not answer.
    """
    os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")
    os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")  # no telemetry, as for DVC
    from mlflow import MlflowClient
    from mlflow.exceptions import MlflowException
    from sqlalchemy.exc import SQLAlchemyError

    uri = configuration.resolved_uri()
    with locked(uri), short_timeouts():  # simultaneous creation of a SQLite database crashes
        try:
            _create_file(uri)
            check_database(uri)
            client = MlflowClient(tracking_uri=uri)
            client.search_experiments(max_results=1)
        except (MlflowException, ImportError, SQLAlchemyError) as error:
            raise _no_answer(configuration, error) from error
    return client


def _create_file(uri: str) -> None:
    """Create an SQLite store with all tables atomically: MLflow cannot read a half-created one."""
    path = Path(uri.removeprefix(SQLITE))
    if not uri.startswith(SQLITE) or path.exists():
        return
    from mlflow import MlflowClient

    for left in path.parent.glob(f".{path.name}.*{PARTIAL_SUFFIX}"):  # left by killed processes
        left.unlink()
    with atomic_path(path) as partial:
        MlflowClient(tracking_uri=f"{SQLITE}{partial}").search_experiments(max_results=1)


def open_experiment(client: Any, configuration: TrackingConfiguration, question: Question) -> str:
    """Identifier of the experiment that answers a question, made if need be."""
    from mlflow.exceptions import MlflowException

    name = configuration.experiment or question.experiment
    with locked(client.tracking_uri):
        try:
            experiment = client.get_experiment_by_name(name)
            if experiment is not None:
                return experiment.experiment_id
            identifier = client.create_experiment(name, artifact_location=configuration.artifact_location())
            if question.text and not configuration.experiment:
                client.set_experiment_tag(identifier, "mlflow.note.content", question.text)
            return identifier
        except MlflowException as error:
            raise _no_answer(configuration, error) from error


def end_killed_runs(client: Any, writes: str | None = None) -> None:
    """End the runs of killed processes, and parents whose children have all ended.

    Args:
        client: Client of the store.
        writes: Output that the caller is about to write. No other process can be writing it, so a run of another
            computer with this output was killed, too.
    """
    with locked(client.tracking_uri):
        experiments = [experiment.experiment_id for experiment in client.search_experiments()]
        if not experiments:
            return
        running = client.search_runs(experiments, "attributes.status = 'RUNNING'")
        for run in running:
            tags = run.data.tags
            process = tags.get("process")
            if process is None or "group" in tags:
                continue
            if processes.is_known_dead(process) or (writes is not None and tags.get("writes") == writes):
                client.set_terminated(run.info.run_id, "KILLED")
        for run in running:
            process = run.data.tags.get("process")
            if "group" in run.data.tags and (process is None or processes.is_known_dead(process)):
                _end_parent(client, run.info.experiment_id, run.info.run_id)


def open_parent(
    client: Any, experiment: str, group: RunGroup, tags: Mapping[str, str], parameters: Mapping[str, Any]
) -> str:
    """The parent run of a group in an experiment; the group's first run creates it."""
    with locked(client.tracking_uri):
        found = client.search_runs([experiment], f"tags.group = '{group.identity}'", max_results=1)
        if found:
            client.update_run(found[0].info.run_id, status="RUNNING")
            return found[0].info.run_id
        own = {
            "mlflow.runName": f"{group.title} {time.strftime('%Y-%m-%d %H:%M:%S')}",
            "group": group.identity,
        }
        if group.process is not None:
            own["process"] = group.process
        run_id = client.create_run(experiment, tags={**tags, **own}).info.run_id
        log_parameters(client, run_id, parameters)
        return run_id


def close_parent(client: Any, experiment: str, parent: str) -> None:
    """End a parent run once none of its children runs any more."""
    with locked(client.tracking_uri):
        _end_parent(client, experiment, parent)


def _end_parent(client: Any, experiment: str, parent: str) -> None:
    children = client.search_runs([experiment], f"tags.{PARENT} = '{parent}'")
    statuses = {child.info.status for child in children} or {"KILLED"}  # killed before its first child
    if "RUNNING" not in statuses:
        client.set_terminated(parent, next(status for status in STATUSES if status in statuses))


def log_parameters(client: Any, run_id: str, tree: Mapping[str, Any]) -> None:
    """Log a configuration as flat parameters."""
    from mlflow.entities import Param

    parameters = [Param(key, str(value)) for key, value in flatten(tree).items()]
    for start in range(0, len(parameters), PARAMETERS_PER_REQUEST):
        client.log_batch(run_id, params=parameters[start : start + PARAMETERS_PER_REQUEST])


def writes_tag(output: str | Path) -> str:
    """Tag that names a run's output."""
    return str(Path(output).absolute())


def _no_answer(configuration: TrackingConfiguration, error: Exception) -> InputError:
    line = str(error).splitlines()[0] if str(error) else type(error).__name__
    return InputError(
        f"tracking.uri={configuration.uri}: {line}; is the tracking server up? (tracking=none goes without)"
    )
