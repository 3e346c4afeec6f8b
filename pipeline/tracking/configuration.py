"""Section `tracking`: where runs are tracked."""

from dataclasses import dataclass

from pipeline.errors import InputError
from pipeline.tracking.project_root import project_folder

SQLITE = "sqlite:///"


@dataclass
class TrackingConfiguration:
    """Keys of `conf/tracking/*.yaml`.

    Attributes:
        enabled: Whether runs are tracked.
        uri: Address of MLflow's tracking store: a server, or a database. A relative path of a SQLite file starts at
            the project's folder.
        artifacts: Folder of a new experiment's artifacts, relative to the project's folder. A server chooses its own.
        experiment: Name; None: each stage's run goes to the experiment of its question (`experiments.py`).
        system_metrics_interval_s: Interval of samples of processor, memory, disk and network; None: no samples.
    """

    enabled: bool
    uri: str
    artifacts: str | None
    experiment: str | None
    system_metrics_interval_s: float | None = None

    def __post_init__(self) -> None:
        interval_s = self.system_metrics_interval_s
        if isinstance(interval_s, float | int) and not interval_s > 0.0:
            raise InputError(
                f"tracking.system_metrics_interval_s is {interval_s}; it must be positive, or null"
            )

    def resolved_uri(self) -> str:
        """The store's address, independent of the current folder."""
        if not self.uri.startswith(SQLITE):
            return self.uri
        return f"{SQLITE}{project_folder() / self.uri.removeprefix(SQLITE)}"

    def artifact_location(self) -> str | None:
        """Address of the folder of artifacts; None: the server decides."""
        if self.artifacts is None or self.uri.startswith("http"):
            return None
        return (project_folder() / self.artifacts).as_uri()
