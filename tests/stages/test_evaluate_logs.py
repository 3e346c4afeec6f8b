"""Stage `evaluate_logs` as a user runs it, against the contract's definitions worked out by hand in float64."""

import json
import subprocess
from pathlib import Path

import jax
import numpy as np
import pytest

from pipeline.configuration.load import MACHINE_DIRECTORY, load_machine, load_section
from pipeline.deployment.graph_logs.evaluate_logs import evaluate_model, evaluate_reaching
from pipeline.dynamics.model.dynamics_model import DynamicsModel, ModelSpecification
from pipeline.dynamics.model.store import save_model
from pipeline.effects.effect import Setting
from pipeline.effects.store import ActiveEffects, load_predictor, save_effects
from pipeline.errors import InputError
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.messages.raw_log import TargetPoses
from pipeline.logs.trajectories import load_logs
from tests.dynamics import reference
from tests.logs.conftest import Session
from tests.logs.samples import foreign_bags as foreign
from tests.reaching.test_logged_trials import chisel, tip
from tests.stages.command import run_stage

START_NS = 1_700_000_000_000_000_000
LAGS = 3


def evaluate(folder: Path, *overrides: str) -> subprocess.CompletedProcess[str]:
    return run_stage("evaluate_logs", *overrides, folder=folder)


def recording(n_rows: int, seed: int, targets: TargetPoses | None = None) -> Session:
    """Joint samples on the machine's grid, each a millisecond after a command: rows are the samples."""
    random, machine = np.random.default_rng(seed), load_machine("bobcat_e10")
    rows = np.arange(n_rows, dtype=np.int64)
    middle, ranges = 0.5 * (machine.lower + machine.upper), machine.upper - machine.lower
    q = middle + 0.3 * ranges * np.sin(
        0.02 * rows[:, None] * random.uniform(0.5, 2, 4) + random.uniform(0, 6, 4)
    )
    stamps = START_NS + 50_000_000 * rows
    commands = np.repeat(random.integers(-1, 2, (n_rows // 10 + 1, 4)), 10, axis=0)[:n_rows].astype(float)
    return Session(stamps, stamps + 500_000, q, stamps - 1_000_000, commands, targets)


def tracked(q: np.ndarray) -> np.ndarray:
    """Velocities by the contract's loop tracker."""
    estimate, integral, velocities = q[0].copy(), np.zeros(4), []
    for row in q:
        error = row - estimate
        integral = integral + 60.0 * error * 0.05
        estimate = estimate + 0.05 * (10.0 * error + integral)
        velocities.append(integral)
    return np.array(velocities)


def expected_errors(specification, parameters, recordings) -> dict[str, np.ndarray]:
    """Both definitions of the contract, section 3."""
    squares = {1: [], 80: []}
    for log in recordings:
        qd, n_rows = tracked(log.q), len(log.q)
        starts = {1: range(40, n_rows - 1), 80: [s for s in range(40, n_rows, 20) if s + 80 <= n_rows - 1]}
        for horizon, rows in starts.items():
            for s in rows:
                arguments = (specification, parameters, log.q, qd, log.command, s, horizon)
                predicted = reference.rollout(*arguments, has_stops=True)
                squares[horizon].append((predicted - log.q[s + 1 : s + 1 + horizon]) ** 2)
    rmse = {horizon: np.sqrt(np.concatenate(parts).mean(axis=0)) for horizon, parts in squares.items()}
    counts = {"n_steps": len(squares[1]), "n_windows": len(squares[80])}
    return {"one_step_rmse": rmse[1], "open_loop_rmse_80": rmse[80], **counts}


@pytest.fixture(scope="module")
def model() -> DynamicsModel:
    machine = load_machine("bobcat_e10")
    return DynamicsModel(
        ModelSpecification(
            parameterization="mlp",
            target="dqdot",
            hidden=[6],
            lags=LAGS,
            legendre_degree=4,
            joints=list(machine.joint_names),
            rate_hz=20.0,
            position_lower=machine.lower.tolist(),
            position_upper=machine.upper.tolist(),
            velocity_limit=[0.7, 0.6, 0.6, 0.7],
            residual_scale=[0.002, 0.003, 0.002, 0.003],
        )
    )


@pytest.fixture(scope="module")
def config() -> IngestConfig:
    return load_section("ingest", IngestConfig)


@pytest.fixture(scope="module")
def loop_tracker() -> LoopTrackerConfig:
    return load_section("control.loop_tracker", LoopTrackerConfig)


@pytest.fixture(scope="module")
def parameters(model):
    return model.initialise(jax.random.key(0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory, model, parameters) -> Path:
    folder = tmp_path_factory.mktemp("evaluate_logs")
    save_model(folder / "model", model, parameters, {}, {}, {})
    return folder


def test_ros1_bags(folder, model, parameters):
    """Two bags: errors are over both, and no window reaches from one into the other."""
    names = load_machine("bobcat_e10").joint_names
    logs = [recording(200, seed=0), recording(150, seed=1)]
    (folder / "ros1").mkdir()
    for name, log in zip(("a", "b"), logs, strict=True):
        foreign.write_rosbag1(folder / f"ros1/{name}.bag", foreign.messages(foreign.ROS1, log, names))
    result = evaluate(folder, "model=model", "logs=ros1", "output=new/ros1.json")
    assert result.returncode == 0, result.stderr
    assert "one_step_rmse: swing " in result.stdout
    content = json.loads((folder / "new/ros1.json").read_text())
    assert set(content) == {"one_step_rmse", "open_loop_rmse_80", "n_windows", "n_steps"}
    expected = expected_errors(model.specification, parameters, logs)
    assert_equal_errors(content, expected)
    assert (content["n_windows"], content["n_steps"]) == (4 + 2, 159 + 109)


def test_mcap_with_targets(folder, model, parameters):
    """The first target is where the arm is at row 100, the second one 0.5 m above where it is at row 200."""
    machine, plain = load_machine("bobcat_e10"), recording(260, seed=2)
    aims = plain.q[[100, 200]]
    raised = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.5]])
    targets = TargetPoses(
        log_time_ns=START_NS + np.array([20, 150]) * 50_000_000,
        position=raised + np.array([tip(q) for q in aims]),
        quaternion=np.array([chisel(q) for q in aims]),
        frame_id="base_link",
    )
    recording(260, seed=2, targets=targets).write(folder / "mcap/drive", machine)
    result = evaluate(folder, "model=model", "logs=mcap", "output=mcap.json")
    assert result.returncode == 0, result.stderr
    content = json.loads((folder / "mcap.json").read_text())
    assert_equal_errors(content, expected_errors(model.specification, parameters, [plain]))
    reaching = content["reaching"]
    assert (reaching["n_episodes"], reaching["sr_002_002"]) == (2, 0.5)
    assert [trial["n_ticks"] for trial in reaching["trials"]] == [130, 109]
    distances = [np.linalg.norm(tip(q) - targets.position[1]) for q in plain.q[151:260]]
    second = reaching["trials"][1]
    assert second["nearest_position_error_m"] == pytest.approx(min(distances), rel=1e-9)
    assert second["final_position_error_m"] == pytest.approx(distances[-1], rel=1e-9)
    assert np.shape(reaching["success_rates"]["matrix"]) == (17, 8)


def assert_equal_errors(content, expected):
    assert (content["n_windows"], content["n_steps"]) == (expected["n_windows"], expected["n_steps"])
    for name in ("one_step_rmse", "open_loop_rmse_80"):
        assert list(content[name]) == sorted(["swing", "boom", "arm", "bucket"])
        for j, joint in enumerate(("swing", "boom", "arm", "bucket")):
            assert content[name][joint] == pytest.approx(expected[name][j], rel=1e-4)


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["model=model", "logs=empty", "output=never.json"], "empty"),
        (["model=other", "logs=short", "output=short"], "output=short: is a folder"),
    ],
)
def test_a_mistake_is_one_line_and_status_2(folder, overrides, said):
    for name in ("empty", "short"):
        (folder / name).mkdir(exist_ok=True)
    result = evaluate(folder, *overrides)
    assert result.returncode == 2, result.stderr
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: evaluate_logs: ") and said in line
    assert not (folder / "never.json").exists()


def test_models_that_cannot_be_used_are_named(folder, model, parameters):
    machine = load_machine("bobcat_e10")
    with pytest.raises(InputError, match=r"nowhere/meta\.json: No such file or directory"):
        load_predictor(folder / "nowhere", machine=machine)
    joints = ["swing", "boom", "arm", "hammer"]
    other = DynamicsModel(ModelSpecification(**(vars(model.specification) | {"joints": joints})))
    save_model(folder / "other", other, parameters, {}, {}, {})
    with pytest.raises(
        InputError, match=r"other: the model is of joints swing .*, hammer \[-2.2, 0.5\] at 20 Hz"
    ):
        load_predictor(folder / "other", machine=machine)
    save_model(folder / "mixed", model, parameters, {}, {}, {})
    setting = Setting(0.05, np.zeros(2), np.ones(2), np.ones(2))
    save_effects(folder / "mixed", ActiveEffects(setting, {}, {}))
    with pytest.raises(InputError, match=r"effects\.json: effects of 2 joints .* the model has 4 joints"):
        load_predictor(folder / "mixed", machine=machine)


def test_logs_that_cannot_be_used_are_named(folder, tmp_path, config, loop_tracker):
    machine = load_machine("bobcat_e10")
    recording(100, seed=3).write(tmp_path / "short/drive", machine)
    predictor = load_predictor(folder / "model", machine=machine)
    logs = load_logs(tmp_path / "short", machine, config, loop_tracker)
    with pytest.raises(InputError, match="field_day: no trajectory is longer than 120 rows"):
        evaluate_model(predictor, logs, machine, "field_day")
    (tmp_path / "short/broken.mcap").write_bytes(b"no bag")
    with pytest.raises(InputError, match=r"broken\.mcap"):
        load_logs(tmp_path / "short", machine, config, loop_tracker)


def test_targets_of_a_machine_without_a_described_arm_are_left_alone(capsys, tmp_path, config, loop_tracker):
    machine = load_machine("bobcat_e10")
    targets = TargetPoses(np.array([START_NS]), np.ones((1, 3)), np.ones((1, 4)), "base_link")
    recording(100, seed=3, targets=targets).write(tmp_path / "drive", machine)
    logs = load_logs(tmp_path, machine, config, loop_tracker)
    assert evaluate_reaching(logs, machine, MACHINE_DIRECTORY, 500)["n_episodes"] == 1
    machine.arm = None
    assert evaluate_reaching(logs, machine, MACHINE_DIRECTORY, 500) is None
    assert "has no section arm or workspace" in capsys.readouterr().out
