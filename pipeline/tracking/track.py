"""Context of a stage's run: opened before its work, closed even if the work fails."""

import contextlib
import logging
import os
import time
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from pipeline.tracking import lineage, processes, store
from pipeline.tracking.configuration import TrackingConfiguration
from pipeline.tracking.experiments import question_of
from pipeline.tracking.stage_run import StageRun

OUTPUT_KEYS = ("output", "report")  # keys of a stage's configuration that name outputs
CONFIGURATION = "configuration.yaml"  # artifact of every run: the resolved configuration


@contextlib.contextmanager
def track(
    name: str,
    configuration: TrackingConfiguration,
    resolved: Mapping[str, Any],
    configuration_yaml: str,
    sweep: tuple[str, str] | None = None,
    unread: Collection[str] = (),
) -> Iterator[StageRun]:
    """Open the run of stage `name`, nested in the run of its pipeline or sweep; close it even after errors.

    Args:
        name: Name of the stage.
        configuration: Where runs are tracked.
        resolved: The stage's whole configuration.
        configuration_yaml: `resolved` as text.
        sweep: For a job of a sweep: the sweep's identity, and the job's identity within it.
        unread: Sections that the stage does not read; they do not become parameters of its run.
    """
    if not configuration.enabled:
        yield StageRun(name)
        return
    client = store.open_store(configuration)
    outputs = [str(resolved[key]) for key in OUTPUT_KEYS if resolved.get(key)]
    writes = store.writes_tag(outputs[0]) if outputs else None
    store.end_killed_runs(client, writes)
    experiment = store.open_experiment(client, configuration, question_of(name))
    common = {
        "profile": str(resolved.get("profile", "")),
        "machine": str(resolved["machine"]["name"]),
        **lineage.code_tags(),
        **lineage.environment_tags(),
    }
    group = _group(name, str(resolved.get("profile", "")), sweep)
    shared = {
        key: value for key, value in resolved.items() if isinstance(value, Mapping)
    }  # not the stage's own
    parent_id = store.open_parent(client, experiment, group, common, shared) if group else None
    job_name = f"{name} {sweep[1]}" if sweep else name
    tags = {
        "mlflow.runName": os.environ.get("DVC_STAGE", job_name),
        "stage": name,
        "process": processes.own_identity(),
        **common,
        **({"writes": writes} if writes else {}),
        **({store.PARENT: parent_id} if parent_id else {}),
    }
    run_id = client.create_run(experiment, tags=tags).info.run_id
    store.log_parameters(client, run_id, {key: resolved[key] for key in resolved if key not in unread})
    client.log_text(run_id, configuration_yaml, CONFIGURATION)
    run, start_s = StageRun(name, run_id, parent_id, client), time.time()
    status = "KILLED"  # interrupted, or ended by the scheduler
    try:
        with _system_metrics(configuration, run_id):
            yield run
        run.outputs(*outputs, since_s=start_s)
        status = "FINISHED"
    except Exception:
        status = "FAILED"
        raise
    finally:
        client.set_terminated(run_id, status)
        if parent_id:
            store.close_parent(client, experiment, parent_id)


def _group(name: str, profile: str, sweep: tuple[str, str] | None) -> store.RunGroup | None:
    """The group that the run belongs to."""
    if sweep is not None:
        return store.RunGroup(f"sweep {sweep[0]}", f"{name} sweep", None)
    dvc = processes.dvc_process()
    return store.RunGroup(f"dvc {dvc}", profile, dvc) if dvc else None


@contextlib.contextmanager
def _system_metrics(configuration: TrackingConfiguration, run_id: str) -> Iterator[None]:
    """Sample processor, memory, disk and network inside the block."""
    if configuration.system_metrics_interval_s is None:
        yield
        return
    logging.getLogger("mlflow.system_metrics").setLevel(logging.WARNING)
    from mlflow.system_metrics.system_metrics_monitor import SystemMetricsMonitor

    monitor = SystemMetricsMonitor(
        run_id, configuration.system_metrics_interval_s, tracking_uri=configuration.resolved_uri()
    )
    monitor.start()
    try:
        yield
    finally:
        monitor.finish()
