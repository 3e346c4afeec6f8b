"""A tracking server that machines share: a real PostgreSQL and a folder of artifacts, one override away."""

import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from mlflow import MlflowClient
from omegaconf import OmegaConf

from pipeline.errors import InputError
from pipeline.tracking import TrackingConfiguration, track
from tests.postgresql import postgresql_server
from tests.tracking_server import tracking_server

ROOT = Path(__file__).parents[2]
RESOLVED = {"profile": "smoke", "machine": {"name": "bobcat_e10"}, "output": "out"}


def configuration_of(uri: str) -> TrackingConfiguration:
    """As `tracking=server tracking.uri=URI` gives it."""
    content = OmegaConf.merge(
        OmegaConf.structured(TrackingConfiguration), OmegaConf.load(ROOT / "conf/tracking/server.yaml")
    )
    content.uri = uri
    configuration = OmegaConf.to_object(content)
    assert isinstance(configuration, TrackingConfiguration)
    return configuration


@pytest.fixture
def server(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    """Address of a server on PostgreSQL, and its folder of artifacts."""
    with (
        postgresql_server() as environment,
        tracking_server(tmp_path, "postgresql+psycopg:///postgres", environment) as address,
    ):
        yield address, tmp_path / "kept"


@pytest.mark.long
def test_runs_and_artifacts_are_the_server_s(
    server: tuple[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    address, kept = server
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").mkdir()
    with track("identify", configuration_of(address), RESOLVED, "profile: smoke\n") as run:
        run.metrics({"model.open_loop_rmse_80.boom": 0.01})
        (tmp_path / "out/model.bin").write_text("1")
        run.artifact(tmp_path / "out/model.bin")
    client = MlflowClient(address)
    (found,) = client.search_runs([client.get_experiment_by_name("models").experiment_id])
    assert found.info.status == "FINISHED" and found.data.metrics == {"model.open_loop_rmse_80.boom": 0.01}
    assert "output.out/model.bin" in found.data.tags
    assert [path.name for path in kept.rglob("model.bin")] == ["model.bin"]
    assert not list(tmp_path.glob("mlflow.db*"))


@pytest.mark.parametrize(
    "uri",
    [
        "http://127.0.0.1:9",
        "postgresql+psycopg://nobody@127.0.0.1:9/studies",
        "oracle9://nobody@127.0.0.1:9/studies",
        "sqlite:///{}/notes.txt",
    ],
)
def test_a_store_that_does_not_answer_is_one_line_within_seconds(uri: str, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine\n" * 100)
    uri = uri.format(tmp_path)
    before, begin_s = dict(os.environ), time.monotonic()
    with pytest.raises(InputError) as error, track("identify", configuration_of(uri), RESOLVED, ""):
        pass
    assert time.monotonic() - begin_s < 60  # alone some ten seconds
    line = str(error.value)
    assert line.startswith(f"tracking.uri={uri}: ") and "\n" not in line
    assert line.endswith("is the tracking server up? (tracking=none goes without)")
    assert {name for name in os.environ if name.startswith("MLFLOW_HTTP")} <= set(before)
    assert (tmp_path / "notes.txt").read_text() == "mine\n" * 100
