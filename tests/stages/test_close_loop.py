"""Stage `close_loop` as a user runs it: mistakes are one line; a practice case gives the contract's document."""

import json
import math
import os
import re
import shutil
import subprocess
import sys
from numbers import Real
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from pipeline.configuration.load import load_machine, load_section
from pipeline.deployment.graph_logs.evaluate_logs import evaluate_model
from pipeline.dynamics.model.dynamics_model import DynamicsModel, ModelSpecification
from pipeline.dynamics.model.store import save_model
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.store import load_effects, load_predictor
from pipeline.logs.formats.writer import write_bag
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.trajectories import LogTrajectories, load_logs
from tests.stages.command import run_stage

ROOT = Path(__file__).parents[2]
PRACTICE = ROOT.parent / "shared/practice"
MACHINE = load_machine("bobcat_e10")
JOINTS = list(MACHINE.joint_names)

# The contract's section 4.
VERDICTS = {"none", "named", "ambiguous", "outside_catalogue", "unexcited"}
FAMILIES = {
    "gain", "delay", "lag", "flow_coupling", "load", "thermal_drift", "supply_variation", "leakage", "backlash",
    "stiction", "end_cushion", "sensor_bias", "timing", "oscillation", "change_point", "other",
}  # fmt: skip
VARIABLES = {
    "command", "command_history", "hold_time", "direction", "position", "velocity", "reversal", "rest_time",
    "time_since_start", "time_since_stop", "absolute_time", "activity", "travel", "zero_command", "clock", "random",
    "latent",
}  # fmt: skip


def start(folder: Path, *overrides: str) -> subprocess.Popen[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "pipeline.stages.close_loop", *overrides, "tracking=none"]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, cwd=folder, env=environment, text=True, **pipes)


def write_session(path: Path, seconds: float, seed: int = 0) -> None:
    """A bag in which every joint moves a little."""
    n_samples, random = round(50 * seconds), np.random.default_rng(seed)
    stamps = 1_700_000_000_000_000_000 + np.arange(n_samples, dtype=np.int64) * 20_000_000
    wander = np.cumsum(random.normal(0, 1e-3, (n_samples, 4)), axis=0)
    write_bag(
        path,
        MACHINE,
        joint_state_header_stamp_ns=stamps,
        joint_state_log_time_ns=stamps + 1_000_000,
        joint_names=JOINTS,
        positions=np.array([0.0, 0.5, -1.0, -1.0]) + wander,
        command_log_time_ns=stamps[::5],
        commands=random.integers(-1, 2, (len(stamps[::5]), 4)).astype(np.int8),
    )


def write_model(folder: Path, joints: list[str]) -> None:
    n = len(joints)
    specification = ModelSpecification(
        parameterization="mlp",
        target="dqdot",
        hidden=[4],
        lags=3,
        legendre_degree=4,
        joints=joints,
        rate_hz=20.0,
        position_lower=MACHINE.lower.tolist(),
        position_upper=MACHINE.upper.tolist(),
        velocity_limit=[0.5] * n,
        residual_scale=[0.002] * n,
    )
    model = DynamicsModel(specification)
    save_model(folder, model, model.initialise(jax.random.key(0)), {}, {}, {})


# overrides besides nominal=logs measured=new, and what the one line says
MISTAKES: dict[str, tuple[list[str], str]] = {
    "missing folder": (["measured=nowhere"], "error: close_loop: nowhere: no such folder; "),
    "empty folder": (["measured=empty"], "error: close_loop: empty: holds no logs "),
    "a recording twice": (
        ["measured=[new,new]", "model=this_machine"],
        "error: close_loop: measured=new, new: trajectory evening is there twice, ",
    ),
    "missing model": (["model=nowhere"], "error: close_loop: nowhere.*"),
    "model of another machine": (
        ["model=other_machine"],
        "error: close_loop: other_machine: the model is of joints swing [-0.9, 0.9], boom [-0.6, 1.2], stick "
        "[-2.4, -0.3], bucket [-2.2, 0.5] at 20 Hz, machine bobcat_e10 has swing ",
    ),
    "unknown kind": (
        ["kind=mlp_torque"],
        "error: close_loop: kind=mlp_torque: not a model kind; use mlp_dq, ",
    ),
    "too short to identify from": (["nominal=short", "kind=mlp_dqdot"], "error: close_loop: identify: "),
    "too short for the one model": (
        ["nominal=short", "measured=long"],
        "error: close_loop: nominal=short: identify: the validation rows hold 0 windows of 80 steps",
    ),
    "too short for the diagnosis": (
        ["nominal=short", "measured=long", "model=this_machine"],
        "error: close_loop: nominal=short: identify: the validation rows hold 0 windows of 80 steps",
    ),
    "too short to hold rows back": (
        ["model=this_machine"],
        "error: close_loop: measured=new: 4 s are too short ",
    ),
    "too short to judge a model on": (
        ["measured=null", "model=this_machine"],
        "error: close_loop: nominal=logs: 4 s are too short ",
    ),
    "neither newer logs nor a model": (
        ["measured=null"],
        "error: close_loop: measured is not named: name logs of the machine as it is, or model=PATH ",
    ),
    "a value out of range": (
        ["close_loop.search.smallest_share=2"],
        "error: close_loop: close_loop.search.smallest_share is 2.0; it must be in (0, 1)",
    ),
}


def given(overrides: list[str]) -> list[str]:
    """Nominal and measured logs where a mistake does not name others."""
    named = {override.partition("=")[0] for override in overrides}
    usual = (("nominal", "logs"), ("measured", "new"))
    return [*overrides, *(f"{key}={value}" for key, value in usual if key not in named)]


@pytest.fixture(scope="module")
def mistakes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, str]]:
    """Exit status and standard error of every mistake."""
    folder = tmp_path_factory.mktemp("mistakes")
    write_session(folder / "logs/morning", seconds=4)
    write_session(folder / "new/evening", seconds=4, seed=1)
    write_session(folder / "short/morning", seconds=2)
    write_session(folder / "long/evening", seconds=240, seed=2)
    (folder / "empty").mkdir()
    write_model(folder / "other_machine", ["swing", "boom", "stick", "bucket"])
    write_model(folder / "this_machine", JOINTS)
    ends = {
        name: run_stage("close_loop", *given(overrides), "output=out", folder=folder)
        for name, (overrides, _) in MISTAKES.items()
    }
    return {name: (end.returncode, end.stderr) for name, end in ends.items()}


@pytest.mark.long
def test_a_command_with_a_mistake_ends_with_one_line_and_status_2(tmp_path: Path) -> None:
    process = start(tmp_path, "nominal=nowhere", "measured=nowhere", "output=out")
    said, errors = process.communicate(timeout=200)
    assert (process.returncode, said) == (2, "")
    assert errors.splitlines() == ["error: close_loop: nowhere: no such folder; name a folder of logs"]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_line_and_status_2(name: str, mistakes: dict[str, tuple[int, str]]) -> None:
    status, errors = mistakes[name]
    assert status == 2, errors
    (line,) = errors.splitlines()
    expected = MISTAKES[name][1]
    assert re.match(expected if ".*" in expected else re.escape(expected), line), line


def test_recordings_given_as_nominal_and_as_measured_are_told_of(tmp_path: Path) -> None:
    write_session(tmp_path / "logs/morning", seconds=4)
    shutil.copytree(tmp_path / "logs/morning", tmp_path / "copied/evening")
    result = run_stage(
        "close_loop", "nominal=logs", "measured=copied", "model=nowhere", "output=out", folder=tmp_path
    )
    assert result.returncode == 2 and "nowhere" in result.stderr  # after the caution
    assert "caution: trajectory evening of measured=copied is among nominal=logs, too; " in result.stdout


def test_without_measured_logs_a_note_is_written_and_the_model_stays(tmp_path: Path) -> None:
    """As `dvc repro` runs it for a user who has logs of his machine, but no later ones."""
    write_model(tmp_path / "model", JOINTS)
    (tmp_path / "measured").mkdir()
    overrides = ("nominal=logs", "measured=measured", "model=model", "output=out", "allow_empty=true")
    result = run_stage("close_loop", *overrides, folder=tmp_path)
    assert result.returncode == 0, result.stderr
    document = json.loads((tmp_path / "out/closed_loop.json").read_text())
    assert set(document) == {"note"} and document["note"].startswith("measured holds no logs")
    assert document["note"] in (tmp_path / "out/report.html").read_text()
    before, after = (tmp_path / f"out/model_{when}/parameters.msgpack" for when in ("before", "after"))
    assert before.read_bytes() == after.read_bytes() == (tmp_path / "model/parameters.msgpack").read_bytes()


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What one run on a practice case wrote: the arm has lost speed in one direction."""
    case = PRACTICE / "p2"
    if not case.is_dir():
        pytest.skip(f"{case.relative_to(ROOT.parent)}: the practice cases are not there")
    folder = tmp_path_factory.mktemp("practice")
    logs = f"nominal={case / 'nominal'}", f"measured={case / 'measured'}"
    smaller = (
        "identify.selected.nfir_dqdot.maximum_epochs=80",
        "close_loop.baselines=true",
        "close_loop.baselines_budget={learning_rates:[1e-3],batches_per_epoch:5,maximum_epochs:1}",
    )
    process = start(folder, *logs, "output=out", *smaller)
    said, errors = process.communicate(timeout=580)
    assert process.returncode == 0, errors
    assert f"see {Path('out/report.html')}" in said
    return folder / "out"


@pytest.fixture(scope="module")
def document(output: Path) -> dict[str, Any]:
    return json.loads((output / "closed_loop.json").read_text())


@pytest.fixture(scope="module")
def exam() -> list[LogTrajectories]:
    """Logs of the same machine as the measured ones, which the loop did not get."""
    settings = load_section("ingest", IngestConfig), load_section("control.loop_tracker", LoopTrackerConfig)
    return load_logs(PRACTICE / "p2/exam", MACHINE, *settings)


@pytest.mark.slow
@pytest.mark.long
def test_the_document_is_the_contracts(document: dict[str, Any]) -> None:
    keys = {
        "detected",
        "probability_none",
        "verdict",
        "effects",
        "alternatives",
        "error",
        "baselines",
        "held_out",
        "next_experiment",
        "trace",
        "power",
    }
    assert set(document) == keys
    assert 0.0 < document["probability_none"] < 0.05  # the arm has lost a quarter of its speed
    even = [of["probability"] for of in document["alternatives"] if of.get("equivalent")]
    assert document["effects"][0]["probability"] + sum(even) >= 0.95
    assert document["verdict"] in VERDICTS
    assert document["detected"] is {"none": False, "unexcited": None}.get(document["verdict"], True)
    assert bool(document["effects"]) == (document["detected"] is True)
    assert isinstance(document["next_experiment"], str) and document["next_experiment"]
    for effect in document["effects"]:
        check_effect(effect)
    visible = {(of["family"], of["joint"]): of["size"] for of in document["power"]}
    assert {joint for _, joint in visible} == set(JOINTS) and {family for family, _ in visible} <= FAMILIES
    assert all(size is None or size > 0 for size in visible.values())
    assert visible["gain", "arm"] < 1.0 - document["effects"][0]["parameters"]["speed_ratio"]["value"]
    for other in document["alternatives"]:
        told = {"family", "joints", "probability", "error_reduction", "why_not"}
        assert set(other) - {"equivalent", "depends_on"} == told
        assert other["family"] in FAMILIES and set(other["joints"]) <= set(JOINTS)
        assert other["why_not"] and is_finite(other["error_reduction"])
    assert set(document["error"]) == {"one_step_rmse", "open_loop_rmse_80"}
    for errors in document["error"].values():
        assert set(errors) == {"before", "after"}
        assert all(is_error_by_joint(by_joint) for by_joint in errors.values())
    on_nominal = {f"{name}_on_nominal" for name in ("effects", "finetune", "blackbox_residual")}
    assert set(document["baselines"]) >= {"finetune", "blackbox_residual", "nominal_floor", *on_nominal}
    assert all(is_error_by_joint(errors["open_loop_rmse_80"]) for errors in document["baselines"].values())
    held_out = document["held_out"]
    assert set(held_out) == {"rule", "n_steps", "trajectories"}
    assert held_out["rule"] and isinstance(held_out["n_steps"], int) and held_out["n_steps"] > 0
    measured = {path.name for path in (PRACTICE / "p2/measured").iterdir()}
    assert {name.partition("#")[0] for name in held_out["trajectories"]} <= measured


def check_effect(effect: dict[str, Any]) -> None:
    keys = {"family", "joints", "depends_on", "parameters", "onset", "certain", "error_reduction"}
    assert set(effect) - {"of"} == keys | {"probability", "e_value", "p_value"}
    assert effect["family"] in FAMILIES and ("of" in effect) == (effect["family"] == "change_point")
    assert effect["joints"] and set(effect["joints"]) <= set(JOINTS)
    for entry in effect["depends_on"]:
        variable, _, joint = entry.partition(":")
        assert variable in VARIABLES and joint in {"", *JOINTS}
    for parameter in effect["parameters"].values():
        assert {"value", "unit"} <= set(parameter) <= {"value", "unit", "ci95"}
        assert is_finite(parameter["value"]) and isinstance(parameter["unit"], str)
        if "ci95" in parameter:
            low, high = parameter["ci95"]
            assert low <= parameter["value"] <= high
    if effect["onset"] is not None:
        assert isinstance(effect["onset"]["trajectory"], str) and is_finite(effect["onset"]["t"])
    assert isinstance(effect["certain"], bool) and 0.0 < effect["probability"] <= 1.0
    assert effect["p_value"] == min(1.0, 1.0 / effect["e_value"]) and is_finite(effect["error_reduction"])


def is_finite(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


def is_error_by_joint(errors: dict[str, Any]) -> bool:
    return list(errors) == JOINTS and all(is_finite(error) and error > 0 for error in errors.values())


@pytest.mark.long
def test_the_verdict_is_the_truth(document: dict[str, Any]) -> None:
    """The only test that reads the truth; nothing was set by it."""
    truth = json.loads((PRACTICE / "p2/truth.json").read_text())
    assert document["verdict"] == "named"
    (effect,) = document["effects"]
    assert (effect["family"], effect["joints"]) == (truth["family"], truth["joints"]) == ("gain", ["arm"])
    said, true = (of["parameters"] for of in (effect, truth))
    assert said["direction"]["value"] == true["direction"]["value"]
    assert said["speed_ratio"]["value"] == pytest.approx(true["speed_ratio"]["value"], rel=0.1)


@pytest.mark.long
def test_the_report_needs_no_other_file(output: Path) -> None:
    page = (output / "report.html").read_text()
    assert "The arm moves" in page
    assert not re.findall(r"""(?:src|href)=["'](?!data:|#)""", page)


@pytest.mark.long
def test_with_its_effects_at_neutral_the_model_after_is_the_model_before(
    output: Path, exam: list[LogTrajectories], tmp_path: Path
) -> None:
    neutral = tmp_path / "neutral"
    shutil.copytree(output / "model_after", neutral)
    effects = load_effects(neutral)
    content = json.loads((neutral / "effects.json").read_text())
    assert effects is not None and content["values"]
    for family in content["values"]:
        values = KNOWN[family](effects.setting).neutral()
        content["values"][family] = {name: value.tolist() for name, value in values.items()}
    (neutral / "effects.json").write_text(json.dumps(content))
    assert not (output / "model_before/effects.json").exists()
    before, after = (evaluated(folder, exam) for folder in (output / "model_before", neutral))
    assert before == after


@pytest.mark.long
def test_the_model_after_knows_how_far_its_values_may_be_off(output: Path, document: dict[str, Any]) -> None:
    effects, arm = load_effects(output / "model_after"), JOINTS.index("arm")
    assert effects is not None
    found = document["effects"][0]["parameters"]["speed_ratio"]
    deviations = effects.deviations["gain"]
    per_direction = [deviations[f"ratio_{way}"] for way in ("positive", "negative")]
    expected = (found["ci95"][1] - found["ci95"][0]) / (2 * 1.96)
    assert expected > 0.0
    np.testing.assert_allclose(max(of[arm] for of in per_direction), expected, rtol=1e-6)
    assert not any(np.delete(of, arm).any() for of in per_direction)


@pytest.mark.long
def test_the_model_after_is_better_on_logs_that_the_loop_never_saw(
    output: Path, exam: list[LogTrajectories]
) -> None:
    before, after = (
        evaluated(output / f"model_{when}", exam)["open_loop_rmse_80"] for when in ("before", "after")
    )
    assert after["arm"] < before["arm"]
    for joint in set(JOINTS) - {"arm"}:
        assert after[joint] < 1.1 * before[joint]


def evaluated(folder: Path, logs: list[LogTrajectories]) -> dict[str, Any]:
    return evaluate_model(load_predictor(folder, machine=MACHINE), logs, MACHINE)
