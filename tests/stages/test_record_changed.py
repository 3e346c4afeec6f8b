"""Stage `record_changed`: the same machine and operator, other sessions, one sealed effect that nobody is told of."""

import subprocess
from pathlib import Path

import pytest
import yaml
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from omegaconf import OmegaConf

from pipeline.plant.sealed.seal import open_seal
from pipeline.stages import close_loop  # noqa: F401  its schema
from pipeline.testbench.recording import operator_and_sessions
from tests.stages.command import run_stage

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
SHORT = ("record_changed.session_minutes=[0.1,0.1]", "profile=smoke", "output=raw/changed")


def record_changed(folder: Path, *overrides: str) -> subprocess.CompletedProcess[str]:
    return run_stage("record_changed", *SHORT, *overrides, folder=folder)


def bags(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.rglob("*.mcap"))}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("changed")
    # as `dvc repro` calls it, with the folders that are recorded and not the user's
    given = ("logs=data/raw/sessions", "measured=raw/changed/sessions", "effects=[delay]")
    result = record_changed(folder, *given)
    assert result.returncode == 0, result.stderr
    return folder


def test_two_sessions_days_later_with_one_sealed_effect(folder: Path) -> None:
    assert [path.name for path in sorted((folder / "raw/changed/sessions").iterdir())] == [
        "2026-03-12-09-00-00",
        "2026-03-13-09-00-00",
    ]
    (effect,) = open_seal(folder / "raw/changed/undeclared.seal")
    assert effect["family"] == "delay"


def test_the_effect_is_in_the_logs_and_nothing_else_differs(folder: Path, tmp_path: Path) -> None:
    """With the same effect every byte is the same, with another one no bag is."""
    for seed, same in ((0, True), (3, False)):
        result = record_changed(tmp_path, "effects=[delay]", f"effects_seed={seed}")
        assert result.returncode == 0, result.stderr
        recorded, again = bags(folder / "raw"), bags(tmp_path / "raw")
        assert list(recorded) == list(again) and len(recorded) == 2
        assert [recorded[name] == again[name] for name in recorded] == [same, same]


@pytest.mark.parametrize("own", ["logs=mine", "measured=mine"])
def test_with_own_logs_nothing_is_recorded(own: str, tmp_path: Path) -> None:
    refused = record_changed(tmp_path, own)
    assert refused.returncode == 2 and f"{own}: no such folder; " in refused.stderr
    (tmp_path / "mine").mkdir()
    result = record_changed(tmp_path, own)
    assert result.returncode == 0, result.stderr
    assert "the logs in mine are your own; nothing is recorded" in result.stdout
    assert (tmp_path / "raw/changed/sessions").is_dir() and not bags(tmp_path)
    assert open_seal(tmp_path / "raw/changed/undeclared.seal") == []


def test_the_operator_is_that_of_record() -> None:
    assert operator_and_sessions(0, 0)[0] == operator_and_sessions(0, 4)[0]


@pytest.mark.parametrize("profile", ["default", "smoke", "paper"])
def test_close_loop_is_told_nothing_of_the_effect(profile: str) -> None:
    """Neither its configuration nor its node of the graph knows what was drawn, or where that stands."""
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        composed = OmegaConf.to_yaml(compose("close_loop", overrides=[f"profile={profile}"]))
    node = yaml.safe_dump(yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]["close_loop"])
    for text in (composed, node):
        for secret in ("effects", "effect_size", "drawn", "undeclared", ".seal"):
            assert secret not in text.replace("pipeline/effects", "").replace("maximum_effects", "")
