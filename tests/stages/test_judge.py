"""Stage `judge` as a user runs it, on a machine with joints in rad and m and continuous commands."""

import csv
import json
from pathlib import Path

import jax
import numpy as np
import pytest

from pipeline.configuration.load import load_machine
from pipeline.dynamics.evaluation.errors import prediction_errors
from pipeline.dynamics.evaluation.predictive_band import PredictiveBand
from pipeline.dynamics.model.dynamics_model import DynamicsModel, ModelSpecification
from pipeline.dynamics.model.fir.model import FirModel
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.model.store import load_model, save_model
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory, read_tuples, write_tuples
from pipeline.machine.specification import JointSpecification, MachineSpecification
from pipeline.stages.judge import load_models
from tests.stages.command import run_stage

pytestmark = pytest.mark.slow

SMALL = [
    "judge.long_prediction_steps=150",
    "judge.narx.command_lags=[1,2,3]",
    "judge.narx.maximum_terms=4",
    "judge.grey_box.grid_points=5",
    "judge.grey_box.refinements=1",
    "judge.growth.horizon=100",
    "judge.growth.resamples=50",
    "judge.extrapolation.configurations=1",
    "judge.extrapolation.steps=80",
    "judge.extrapolation.all_combinations_up_to_joints=0",
]


def log(machine: MachineSpecification, name: str, seed: int, n_rows: int, day: int) -> Trajectory:
    """Joints that follow continuous commands with a first-order lag and a dead time of two steps."""
    random, ranges = np.random.default_rng(seed), machine.upper - machine.lower
    middle = 0.5 * (machine.lower + machine.upper)
    q, v, a = np.tile(middle, (n_rows, 1)), np.zeros((n_rows, 4)), np.zeros((n_rows, 4))
    for t in range(2, n_rows - 1):
        a[t] = random.uniform(-1, 1, 4) if t % 10 == 0 else a[t - 1]
        a[t] = np.where(np.abs(q[t] - middle) > 0.3 * ranges, -np.sign(q[t] - middle), a[t])
        v[t + 1] = v[t] + 0.2 * (0.4 * ranges * a[t - 2] - v[t])
        q[t + 1] = q[t] + 0.05 * v[t + 1]
    t_s = 0.05 * np.arange(n_rows)
    stamp_ns = (1e9 * (86_400 * day + t_s)).astype(np.int64)
    return Trajectory(name, t_s, stamp_ns, q, v, a, np.arange(n_rows) >= 0.9 * n_rows)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tuples to learn from and to judge on, and an untrained model."""
    folder, machine = tmp_path_factory.mktemp("judge"), load_machine("rc_excavator")
    write_tuples(folder / "sessions/monday.parquet", machine, [log(machine, "monday", 0, 1500, day=1)])
    write_tuples(folder / "held_out/tuesday.parquet", machine, [log(machine, "tuesday", 1, 700, day=2)])
    specification = ModelSpecification(
        parameterization="mlp",
        target="dqdot",
        hidden=[8],
        lags=4,
        legendre_degree=4,
        joints=list(machine.joint_names),
        rate_hz=20.0,
        position_lower=machine.lower.tolist(),
        position_upper=machine.upper.tolist(),
        velocity_limit=(0.5 * (machine.upper - machine.lower)).tolist(),
        residual_scale=(0.02 * (machine.upper - machine.lower)).tolist(),
    )
    model = DynamicsModel(specification)
    save_model(folder / "mlp_dqdot", model, model.initialise(jax.random.key(0)), {}, {}, {})
    return folder


@pytest.fixture(scope="module")
def judged(folder: Path) -> Path:
    result = run_stage(
        "judge",
        *SMALL,
        "models=[mlp_dqdot]",
        "tuples=sessions",
        "held_out=held_out",
        "output=out",
        "machine=rc_excavator",
        folder=folder,
    )
    assert result.returncode == 0, result.stderr
    assert "errors: A reference is better than every model on 8 of these 8 figures." in result.stdout
    return folder / "out"


def test_metrics_are_flat_and_those_of_the_library(folder: Path, judged: Path) -> None:
    metrics = json.loads((judged / "judgement.json").read_text())
    assert all(isinstance(value, int | float) for value in metrics.values())
    held_out = read_tuples(folder / "held_out", load_machine("rc_excavator"))
    free = LearnedPredictor(*load_model(folder / "mlp_dqdot"), has_stops=False)
    errors = prediction_errors(free, held_out)
    for j, joint in enumerate(load_machine("rc_excavator").joint_names):
        expected = errors.open_loop_rmse_80[j]
        assert metrics[f"mlp_dqdot.open_loop_rmse_80.{joint}"] == pytest.approx(expected, rel=1e-5)
        assert metrics[f"arx_dq.open_loop_rmse_80.{joint}"] < 0.01 * expected  # the data are linear
        assert f"grey_box.drift_at_rest.{joint}" in metrics
    assert metrics["reference_wins.errors"] == 8
    assert metrics["n_windows"] == errors.n_windows


def test_tables_say_who_wins(judged: Path) -> None:
    sentence, *_ = (judged / "tables/errors.md").read_text().splitlines()
    assert sentence.startswith("A reference is better than every model on 8 of these 8 figures.")
    assert "swing [rad]" in (judged / "tables/errors.md").read_text()
    assert "boom [m]" in (judged / "tables/extrapolation.md").read_text()
    names = {path.name for path in (judged / "tables").iterdir()}
    comparisons = {
        f"{name}.{kind}" for name in ("errors", "error_growth", "extrapolation") for kind in ("md", "csv")
    }
    assert names == comparisons | {"narx.md", "grey_box.md"}
    with (judged / "tables/error_growth.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 5 * 4 * 100  # predictors, joints, horizons
    assert all(float(row["lower"]) <= float(row["rmse"]) <= float(row["upper"]) for row in rows)


def test_figures_are_there(judged: Path) -> None:
    names = {path.name for path in (judged / "figures").iterdir()}
    assert names == {"open_loop_models.svg", "open_loop_references.svg", "error_growth.svg"}


def test_models_that_cannot_be_judged_are_refused(folder: Path) -> None:
    model = str(folder / "mlp_dqdot")
    with pytest.raises(InputError, match="another predictor is called mlp_dqdot already"):
        load_models([model, model], load_machine("rc_excavator"))
    other = MachineSpecification("one", 20.0, [JointSpecification("only", 0.0, 1.0)])
    with pytest.raises(
        InputError, match=r"machine one has only \[0, 1\] at 20 Hz; give the model's machine=NAME"
    ):
        load_models([model], other)
    with pytest.raises(InputError, match=r"models=\[PATH\]"):
        load_models([], load_machine("rc_excavator"))


def test_the_fifth_kind_is_identified_with_its_band(folder: Path, tmp_path: Path) -> None:
    training = "{hidden:[8],lags:6,maximum_epochs:2,ensemble:{members:2,hidden:[4]}}"
    result = run_stage(
        "identify",
        f"identify.selected.nfir_dqdot={training}",
        "identify.evaluation_windows=8",
        "machine=rc_excavator",
        "model=nfir",
        "checkpoints=null",
        "tuples=sessions",
        "held_out=held_out",
        f"output={tmp_path / 'nfir'}",
        folder=folder,
    )
    assert result.returncode == 0, result.stderr
    machine = load_machine("rc_excavator")
    model, parameters = load_model(tmp_path / "nfir")
    assert isinstance(model, FirModel)
    assert model.specification.demand_beyond == []  # commands are proportional
    sessions, (unseen,) = read_tuples(folder / "sessions", machine), read_tuples(folder / "held_out", machine)
    coverage = PredictiveBand(model, parameters, sessions).coverage([unseen])
    metrics = json.loads((tmp_path / "nfir/metrics.json").read_text())
    for steps in (20, 80):
        for name, values in coverage._asdict().items():
            told = metrics[f"band_{name}_after_{steps}_steps"]
            np.testing.assert_allclose([told[j] for j in machine.joint_names], values[steps - 1], rtol=1e-5)
