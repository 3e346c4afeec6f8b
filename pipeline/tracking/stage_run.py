"""A stage's reports to its MLflow run."""

import contextlib
import json
import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import InputError
from pipeline.tracking import champion
from pipeline.tracking.lineage import content_hash, written_since
from pipeline.tracking.store import PARENT

NOT_IN_A_TAG = re.compile(r"[^/\w.\- :]")  # MLflow's rule for names
LONGEST_TAG = 250


@dataclass
class StageRun:
    """Reports of one stage; without tracking every call is a no-op."""

    name: str
    run_id: str | None = None
    parent_id: str | None = None
    _client: Any = None

    @property
    def is_tracked(self) -> bool:
        """Whether reports are stored."""
        return self._client is not None

    def metrics(self, values: Mapping[str, float], step: int = 0) -> None:
        """Report scalar metrics, by dotted names."""
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
        """Report the run's inputs: tags `input.<path>` with DVC's hashes, and MLflow's data sets."""
        if self._client is None:
            return
        from mlflow.entities import Dataset, DatasetInput, InputTag

        data_sets = []
        for path in paths:
            digest = content_hash(Path(path))
            if digest is None:
                continue
            shown = shown_path(path)
            self._client.set_tag(self.run_id, tag_name("input", shown), digest)
            source = json.dumps({"uri": Path(path).absolute().as_uri()})
            data_set = Dataset(shown, digest, "local", source)
            data_sets.append(DatasetInput(data_set, [InputTag("mlflow.data.context", self.name)]))
        if data_sets:
            self._client.log_inputs(self.run_id, data_sets)

    def outputs(self, *paths: str | Path, since_s: float) -> None:
        """Report files written since a time (s since the epoch): tags `output.<path>` with DVC's hashes."""
        if self._client is None:
            return
        for path in paths:
            for written, digest in written_since(Path(path), since_s).items():
                self._client.set_tag(self.run_id, tag_name("output", shown_path(written)), digest)

    @contextlib.contextmanager
    def nested(self, name: str) -> Iterator["StageRun"]:
        """A child run, for results that are compared under the same metric names.

        Args:
            name: Name of the child run.
        """
        if self._client is None:
            yield StageRun(name)
            return
        own = self._client.get_run(self.run_id)
        kept = ("stage", "profile", "machine", "process", "writes")
        tags = {key: own.data.tags[key] for key in kept if key in own.data.tags}
        run_id = self._client.create_run(
            own.info.experiment_id, tags={**tags, "mlflow.runName": name, PARENT: self.run_id}
        ).info.run_id
        status = "FAILED"
        try:
            yield StageRun(name, run_id, self.run_id, self._client)
            status = "FINISHED"
        finally:
            self._client.set_terminated(run_id, status)

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
            package: Package that it imports; stored with the model.
            artifacts: Files and folders of the model, by the names that the code uses.
            requirements: Packages with versions, installed where the model is served.
            registered_name: Name in MLflow's registry.
            example: Example input of the model.
            name: Name of the model in the run.
            alias: Alias of the new version, moved from its present version. None: the new version becomes the champion
                if its run's metrics are better.
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
        self._client.update_run(self.run_id, status="RUNNING")  # which start_run's end has ended
        version = str(logged.registered_model_version)
        if alias is not None:
            self._client.set_registered_model_alias(registered_name, alias, version)
        elif self.run_id is not None:
            champion.promote_if_better(self._client, registered_name, version, self.run_id)

    def promote(self, registered_name: str, new: Path, former: Path) -> str:
        """Make a folder the champion among the versions of `registered_name`; the new version's number.

        Args:
            registered_name: Name in MLflow's registry.
            new: Folder.
            former: Folder that becomes the version to go back to, where there is no champion yet.

        Raises:
            InputError: The run is not tracked, so there is no registry.
        """
        client, run_id = self._registry()
        if champion.champion_version(client, registered_name) is None:
            self.artifact(former)
            champion.crown(
                client, registered_name, champion.add_version(client, registered_name, run_id, former.name)
            )
        self.artifact(new)
        version = champion.add_version(client, registered_name, run_id, new.name)
        champion.crown(client, registered_name, version)
        return version

    def roll_back(self, registered_name: str) -> tuple[str, str]:
        """See `champion.roll_back`.

        Raises:
            InputError: There is none to go back to, or no registry.
        """
        return champion.roll_back(self._registry()[0], registered_name)

    def _registry(self) -> tuple[Any, str]:
        if self._client is None or self.run_id is None:
            raise InputError(
                "tracking=none: champions stand in the tracking store; name one, tracking=sqlite"
            )
        return self._client, self.run_id

    def parent_metrics(self, values: Mapping[str, float], tags: Mapping[str, str] | None = None) -> None:
        """Report metrics of the whole pipeline on the parent run, so that pipeline runs can be compared."""
        if self._client is None or self.parent_id is None:
            return
        StageRun(self.name, self.parent_id, None, self._client).metrics(values)
        for key, value in (tags or {}).items():
            self._client.set_tag(self.parent_id, key, value)


def shown_path(path: str | Path) -> str:
    """A path as in `dvc.lock`: relative to the current folder if it lies inside."""
    return os.path.normpath(path)


def tag_name(role: str, path: str) -> str:
    """Name of the tag that holds a path's hash."""
    return NOT_IN_A_TAG.sub("_", f"{role}.{path}")[:LONGEST_TAG]
