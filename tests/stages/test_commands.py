"""The stages as a user runs them: commands with overrides, from any folder, with mistakes."""

import importlib
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars
import pytest
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from omegaconf import OmegaConf, open_dict

from pipeline.configuration import load
from pipeline.configuration.load import load_machine
from pipeline.deployment.components.supervision.supervisor_rules import RULES
from pipeline.errors import InputError
from pipeline.logs.formats.writer import write_bag
from tests.stages.command import run_stage

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
STAGES = sorted(path.stem for path in (ROOT / "pipeline/stages").glob("[a-z]*.py"))
LOOP = ["nominal=a", "measured=b", "output=c"]
PROFILES = sorted(path.stem for path in (ROOT / "conf/profile").glob("*.yaml"))


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one bag of ten seconds."""
    folder = tmp_path_factory.mktemp("logs")
    random = np.random.default_rng(0)
    stamps = 1_700_000_000_000_000_000 + np.arange(500, dtype=np.int64) * 20_000_000
    write_bag(
        folder / "morning",
        load_machine("bobcat_e10"),
        joint_state_header_stamp_ns=stamps,
        joint_state_log_time_ns=stamps + 1_000_000,
        joint_names=load_machine("bobcat_e10").joint_names,
        positions=np.array([0.0, 0.5, -1.0, -1.0]) + np.cumsum(random.normal(0, 1e-3, (500, 4)), axis=0),
        command_log_time_ns=stamps[::5],
        commands=random.integers(-1, 2, (100, 4)).astype(np.int8),
    )
    return folder


@pytest.mark.parametrize("stage", STAGES)
def test_help_has_the_stages_keys_on_one_screen(stage: str, tmp_path: Path) -> None:
    said = run_stage(stage, "--help", folder=tmp_path)
    assert said.returncode == 0 and said.stdout.startswith(f"Stage `{stage}`: ")
    own = OmegaConf.load(ROOT / f"conf/{stage}.yaml")
    assert {str(key) for key in own if key != "defaults"} <= set(
        re.findall(r"^(\w+):", said.stdout, re.MULTILINE)
    )
    assert len(said.stdout.splitlines()) <= 60 and "bobcat_e10" in said.stdout


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("stage", STAGES)
def test_every_stage_takes_every_profile(stage: str, profile: str) -> None:
    """All sections that a stage types are complete and within their ranges."""
    importlib.import_module(f"pipeline.stages.{stage}")
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        composed = compose(stage, overrides=[f"profile={profile}"])
    with open_dict(composed):
        composed.profile = profile  # an interpolation that only a running job resolves
    for key in ("repair", "output"):  # other keys refer to them
        if OmegaConf.is_missing(composed, key):
            composed[key] = "value"
    for key in OmegaConf.missing_keys(composed):
        OmegaConf.update(composed, key, "value" if key != "seed" else 0)
    assert OmegaConf.to_object(composed).machine.name == "bobcat_e10"


@pytest.mark.parametrize("stage", STAGES)
def test_all_rules_are_on_unless_the_experiment_says_otherwise(stage: str) -> None:
    importlib.import_module(f"pipeline.stages.{stage}")
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        composed = compose(stage)
    if "deployment" not in composed:
        return
    is_on = stage not in ("sim2sim", "sim2real", "sweep_delays", "prove", "measure_delays")
    assert composed.deployment.supervisor.rules == (list(RULES) if is_on else [])
    assert composed.deployment.interface.supervised == is_on


def test_paths_are_relative_to_the_callers_folder(logs: Path, tmp_path: Path) -> None:
    result = run_stage("ingest", f"logs={os.path.relpath(logs, tmp_path)}", "output=tuples", folder=tmp_path)
    assert result.returncode == 0, result.stderr
    tuples = polars.read_parquet(tmp_path / "tuples/morning.parquet")
    assert set(tuples["split"]) == {"train", "validation"}
    assert json.loads((tmp_path / "tuples/quality.json").read_text())["n_logs"] == 1


def test_a_mistake_is_one_line_and_status_2(tmp_path: Path) -> None:
    """As a process of its own, which alone shows what a user sees."""
    command = [
        sys.executable,
        "-m",
        "pipeline.stages.ingest",
        "logs=nowhere",
        "output=tuples",
        "tracking=none",
    ]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    result = subprocess.run(
        command, capture_output=True, text=True, cwd=tmp_path, env=environment, check=False
    )
    assert result.returncode == 2
    assert result.stderr.splitlines() == ["error: ingest: nowhere: no such folder; name a folder of logs"]


def test_a_missing_key_is_named(tmp_path: Path) -> None:
    result = run_stage("ingest", "output=tuples", folder=tmp_path)
    assert result.returncode == 2
    assert result.stderr.splitlines() == ["error: ingest: `logs` is missing; add logs=VALUE to the command"]


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("ingest.maximum_gap=1", "Key 'maximum_gap' not in 'IngestConfig'"),
        ("ingest.maximum_gap_s=long", "Value 'long' of type 'str' could not be converted to Float"),
        ("machine=mine", "Could not find 'machine/mine'"),
        ("close_loop.engine=posterior", "Key 'engine' not in 'CloseLoopConfig'"),
    ],
)
def test_a_bad_override_is_one_line_too(override: str, said: str, tmp_path: Path) -> None:
    stage = "close_loop" if override.startswith("close_loop") else "ingest"
    result = run_stage(stage, "output=y", override, folder=tmp_path)
    assert result.returncode == 2
    (told,) = result.stderr.splitlines()
    assert told.startswith(f"error: {stage}: ") and said in told


def test_a_broken_machine_file_is_named_with_its_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "machine").mkdir()
    (tmp_path / "machine/mine.yaml").write_text("name: mine\n\trate_hz: 20.0")
    place = f'"{tmp_path}/machine/mine.yaml", line 2'
    words = ("--config-dir", str(tmp_path), "machine=mine", "logs=a", "output=b")
    result = run_stage("ingest", *words, folder=tmp_path)
    assert result.returncode == 2
    (told,) = result.stderr.splitlines()
    assert told.startswith("error: ingest: ") and place in told
    monkeypatch.setattr(load, "MACHINE_DIRECTORY", tmp_path / "machine")
    with pytest.raises(InputError, match=f"mine.yaml: not YAML .*{place}"):
        load.load_machine("mine")


def test_a_value_out_of_range_is_refused_before_work_starts(logs: Path, tmp_path: Path) -> None:
    result = run_stage("ingest", f"logs={logs}", "output=tuples", "ingest.maximum_gap_s=-1", folder=tmp_path)
    assert result.returncode == 2
    assert "ingest.maximum_gap_s is -1.0; it must be positive" in result.stderr
    assert not (tmp_path / "tuples").exists()


@pytest.mark.parametrize(
    ("stage", "overrides", "said"),
    [
        ("ingest", ["logs=a", "output=${nope}"], "`output`: Interpolation key 'nope' not found; correct it"),
        (
            "ingest",
            ["logs=a", "output=b", "ingest.maximum_gap_s=inf"],
            "ingest.maximum_gap_s is inf; it must be a",
        ),
        (
            "close_loop",
            [*LOOP, "close_loop.gate.smallest_e_value=nan"],
            "close_loop.gate.smallest_e_value is nan; it must be",
        ),
        ("close_loop", [*LOOP, "close_loop.seed=-1"], "close_loop.seed is -1; it must not be negative"),
        (
            "close_loop",
            [*LOOP, "close_loop.exclude=[dealy]"],
            "close_loop.exclude has dealy, which is not tried",
        ),
        ("ppo", ["model=a", "output=b", "seed=-1"], "seed is -1; it must not be negative"),
        ("measure_floor", ["model=a", "tuples=[]", "output=b"], "tuples is empty; name at least one folder"),
        (
            "record",
            ["effects=[gain]", "effect_size=-1", "output=b"],
            "effect_size is -1.0; it must be positive",
        ),
        (
            "sim2real",
            ["model=a", "output=b", "policy=c", "start_time=noon"],
            "start_time is noon; write date and",
        ),
        (
            "sim2real",
            ["model=a", "output=b", "policy=c", "start_time=2026-04-01"],
            "write date and time with zone",
        ),
        (
            "teleoperate",
            ["output=b", "graph=simulated_time", "condition=attic"],
            "condition=attic: the plant has these: workshop, field",
        ),
        (
            "run_graph",
            ["model=a", "output=b", "policy=c", "targets=0"],
            "targets is 0; it must be at least 1",
        ),
        (
            "pictures",
            ["cells=nowhere.yaml"],
            "cells=nowhere.yaml: cannot be read (No such file or directory); ",
        ),
        (
            "report",
            ["cells=list.yaml"],
            "cells=list.yaml: has no models, targets, seeds, identified, logs; name",
        ),
        ("reward_ablation", ["cells=broken.yaml"], "cells=broken.yaml: not YAML ("),
    ],
)
def test_a_value_that_cannot_be_is_one_line(
    stage: str, overrides: list[str], said: str, tmp_path: Path
) -> None:
    (tmp_path / "list.yaml").write_text("[1, 2]")
    (tmp_path / "broken.yaml").write_text("{")
    result = run_stage(stage, *overrides, folder=tmp_path)
    assert result.returncode == 2, result.stderr
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"error: {stage}: ") and said in line


def test_own_logs_take_the_place_of_recorded_ones(logs: Path, tmp_path: Path) -> None:
    result = run_stage("record", f"logs={logs}", "output=raw", "profile=smoke", folder=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "nothing is recorded" in result.stdout
    assert not list(tmp_path.rglob("*.mcap"))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which sessions were recorded, and own logs laid beside."""
    folder = tmp_path_factory.mktemp("recorded")
    short = ["record.session_minutes=[0.05]", "record.held_out_minutes=0.05"]
    result = run_stage("record", *short, "output=raw", "profile=smoke", folder=folder)
    assert result.returncode == 0, result.stderr
    result = run_stage(
        "record_changed",
        "record_changed.session_minutes=[0.05]",
        "output=raw/changed",
        "profile=smoke",
        folder=folder,
    )
    assert result.returncode == 0, result.stderr
    (folder / "mine").mkdir()
    (folder / "mine/day.bag").write_text("mine")
    return folder


OWN_NAME = "2024-05-06-09-00-00"  # as `rosbag record` calls bags, and `record` its own


def everything(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and "runs" not in path.parts
    }


@pytest.mark.parametrize(
    ("stage", "place"),
    [
        ("record", "raw/sessions"),
        ("record", "raw/held_out"),
        ("record_changed", "raw/changed/sessions"),
    ],
)
@pytest.mark.parametrize("own", [["logs=mine"], []])
def test_a_bag_laid_beside_recorded_ones_is_not_deleted_with_them(
    stage: str, place: str, own: list[str], recorded: Path, tmp_path: Path
) -> None:
    folder = shutil.copytree(recorded, tmp_path / "copy")
    (folder / place / OWN_NAME).mkdir()
    (folder / place / OWN_NAME / "day.bag").write_text("mine")
    before = everything(folder)
    output = "raw/changed" if stage == "record_changed" else "raw"
    refused = run_stage(stage, *own, f"output={output}", "profile=smoke", folder=folder)
    assert refused.returncode == 2
    (line,) = refused.stderr.splitlines()
    assert f"{place}: holds logs that {stage} did not write ({OWN_NAME}); move them" in line
    assert everything(folder) == before


@pytest.mark.parametrize(
    ("stage", "logs", "said"),
    [
        ("record", "raw/held_out", "lies in raw/held_out"),
        ("record", "raw/sessions/2026-03-02-09-00-00", "lies in raw/sessions"),
        ("record", "link", "lies in raw/held_out"),
        ("record", "raw", "contains raw/sessions"),
        ("record_changed", "raw/changed/sessions", "lies in raw/changed/sessions"),
        ("record_changed", "raw", "contains raw/changed/sessions"),
    ],
)
def test_recorded_bags_that_are_named_as_own_logs_are_not_deleted(
    stage: str, logs: str, said: str, recorded: Path, tmp_path: Path
) -> None:
    folder = shutil.copytree(recorded, tmp_path / "copy")
    (folder / "link").symlink_to("raw/held_out")
    before = everything(folder)
    output = "raw/changed" if stage == "record_changed" else "raw"
    refused = run_stage(stage, f"logs={logs}", f"output={output}", "profile=smoke", folder=folder)
    assert refused.returncode == 2
    (line,) = refused.stderr.splitlines()
    assert f"logs={logs}: {said}, whose recordings are deleted where own logs take their place; " in line
    assert everything(folder) == before


def test_own_logs_leave_no_recorded_ones_to_be_taken_for_data(recorded: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(recorded, tmp_path / "copy")
    (folder / "raw/sessions/.2026-03-02-09-00-00.partial").mkdir()  # which a killed run left
    (folder / "raw/sessions/.note").write_text("mine")
    for stage, output in (("record", "raw"), ("record_changed", "raw/changed")):
        assert list((folder / output / "sessions").glob("*/*.mcap"))
        result = run_stage(stage, "logs=mine", f"output={output}", "profile=smoke", folder=folder)
        assert result.returncode == 0, result.stderr
        assert not list((folder / output).glob("recorded.txt"))
    assert not list(folder.rglob("*.mcap"))
    assert (folder / "raw/held_out").is_dir()
    assert [path.name for path in (folder / "raw/sessions").iterdir()] == [".note"]


def test_a_sweep_runs_every_value(logs: Path, tmp_path: Path) -> None:
    overrides = ["-m", f"logs={logs}", "ingest.validation_fraction=0.1,0.2"]
    result = run_stage("ingest", *overrides, "output=out_${ingest.validation_fraction}", folder=tmp_path)
    assert result.returncode == 0, result.stderr
    shares = [
        polars.read_parquet(tmp_path / f"out_{fraction}/morning.parquet")["split"].eq("validation").mean()
        for fraction in (0.1, 0.2)
    ]
    assert shares == pytest.approx([0.1, 0.2], abs=0.01)


def test_a_missing_model_is_named(tmp_path: Path) -> None:
    result = run_stage("ppo", "model=nowhere", "seed=0", "output=policy", folder=tmp_path)
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) >= 1 and "nowhere" in result.stderr.splitlines()[-1]


def test_a_machine_without_a_plant_gets_a_note_instead_of_trials(tmp_path: Path) -> None:
    command = ("model=nowhere", "policy=none", "machine=rc_excavator", "output=trials")
    done = run_stage("sim2real", *command, "allow_empty=true", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    note = json.loads((tmp_path / "trials/goals.json").read_text())["note"]
    assert note.startswith("there is no simulated plant of rc_excavator")
    assert run_stage("sim2real", *command, folder=tmp_path).returncode == 2


@pytest.mark.parametrize("stage", ["identify", "ppo", "evaluate_icem"])
def test_an_output_beside_the_folder_costs_no_folder_of_the_same_name(stage: str, tmp_path: Path) -> None:
    """A finished run deletes its checkpoints, whose default place would be `data2` here."""
    here = tmp_path / "here"
    (here / "data2").mkdir(parents=True)
    (here / "data2" / "results.txt").write_text("mine")
    model = {"identify": "tuples=none", "ppo": "model=none", "evaluate_icem": "model=none"}[stage]
    variant = ["variant=icem"] if stage == "evaluate_icem" else []
    done = run_stage(stage, model, *variant, "output=../data2", folder=here)
    assert done.returncode == 2
    assert "checkpoints/../data2" in done.stderr and "without .." in done.stderr
    assert (here / "data2" / "results.txt").read_text() == "mine"


def test_a_folder_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A read-only checkout: one line instead of Hydra's traceback."""
    monkeypatch.setattr("pipeline.files.path_checks.os.access", lambda *_: False)
    ended = run_stage("ingest", "logs=logs", "output=tuples", folder=tmp_path)
    assert ended.returncode == 2
    assert ended.stderr.startswith("error: ingest: hydra.run.dir=runs: . must not be written to")
    assert ended.stderr.count("\n") == 1 and not list(tmp_path.iterdir())
