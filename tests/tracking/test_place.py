"""Where runs are kept, whatever the folder that a command is started in."""

from pathlib import Path

import pytest

from pipeline.tracking import TrackingConfiguration
from pipeline.tracking.project_root import CODE, project_folder


@pytest.fixture
def project(tmp_path: Path) -> Path:
    (tmp_path / "project/.dvc/tmp/exps/tmp1/.dvc").mkdir(parents=True)
    (tmp_path / "project/data").mkdir()
    return (tmp_path / "project").resolve()


@pytest.mark.parametrize("folder", [".", "data", ".dvc/tmp/exps/tmp1", ".dvc/tmp/exps/standalone/tmp2"])
def test_runs_are_the_project_s_also_of_queued_experiments(project: Path, folder: str) -> None:
    assert project_folder(project / folder) == project


def test_outside_of_any_project_they_are_those_of_the_code(tmp_path: Path) -> None:
    assert project_folder(tmp_path) == CODE == Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("uri", "resolved", "artifacts"),
    [
        ("sqlite:///mlflow.db", "sqlite:///{project}/mlflow.db", "file://{project}/kept"),
        ("sqlite:////srv/mlflow.db", "sqlite:////srv/mlflow.db", "file://{project}/kept"),
        ("postgresql+psycopg:///runs", "postgresql+psycopg:///runs", "file://{project}/kept"),
        ("http://server:5000", "http://server:5000", None),  # the server decides
    ],
)
def test_addresses_do_not_depend_on_the_folder(
    project: Path, monkeypatch: pytest.MonkeyPatch, uri: str, resolved: str, artifacts: str | None
) -> None:
    monkeypatch.chdir(project / "data")
    configuration = TrackingConfiguration(True, uri, "kept", None)
    assert configuration.resolved_uri() == resolved.format(project=project)
    assert configuration.artifact_location() == (artifacts and artifacts.format(project=project))
