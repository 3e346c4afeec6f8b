"""A model from the registry says what the model folder says, also where nothing of this repository is installed."""

import shutil
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pandas
import pytest

from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.model.store import save_model
from pipeline.effects.effect import Setting
from pipeline.effects.store import ActiveEffects, predictor, save_effects
from pipeline.tracking import TrackingConfiguration, track
from pipeline.tracking.registry.publish import example_rows, publish_dynamics_model
from tests.dynamics.conftest import LAGS, make_specification, random_trajectory

mlflow = pytest.importorskip("mlflow")
UV = Path(sys.executable).with_name("uv")
N_MEASURED, HORIZON = LAGS + 5, 12


@pytest.fixture(scope="module")
def published(empty_store, tmp_path_factory):
    """Tracking store with one registered KAN; the model and its parameters."""
    folder = tmp_path_factory.mktemp("registry")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        shutil.copy(empty_store, folder / "mlflow.db")
        uri = f"sqlite:///{folder}/mlflow.db"
        configuration = TrackingConfiguration(True, uri, str(folder / "mlruns"), "dynamics")
        model = DynamicsModel(make_specification("kan", "dqdot"))
        parameters = model.initialise(jax.random.key(4))
        save_model(folder / "model", model, parameters, {}, {}, {"epoch": [1.0]})
        with track("identify", configuration, {"machine": {"name": "m"}}, "") as run:
            trajectory = random_trajectory(1, 60)
            publish_dynamics_model(run, folder / "model", model, "kan_dqdot", trajectory)
            publish_dynamics_model(run, folder / "model", model, "kan_dqdot", trajectory)
        yield uri, model, parameters


@pytest.fixture(scope="module")
def asked():
    """Rows to predict, and what they were."""
    trajectory = random_trajectory(2, 60)
    model = DynamicsModel(make_specification("kan", "dqdot"))
    return trajectory, example_rows(model, trajectory, N_MEASURED, HORIZON)


def expected(published, trajectory):
    _, model, parameters = published
    predictor = LearnedPredictor(model, parameters)
    return predictor.predict(trajectory, np.array([N_MEASURED - 1]), HORIZON)[0]


@pytest.mark.long
def test_a_version_has_signature_and_example_and_predicts_as_the_folder_does(published, asked):
    trajectory, rows = asked
    mlflow.set_tracking_uri(published[0])
    loaded = mlflow.pyfunc.load_model("models:/kan_dqdot/2")
    assert loaded.metadata.signature.inputs.input_names() == list(rows.columns)
    assert loaded.metadata.signature.outputs.input_names() == ["q_lift", "q_slide"]
    example = loaded.input_example
    assert len(loaded.predict(example)) == example["q_lift"].isna().sum() > 0
    predicted = loaded.predict(rows)
    np.testing.assert_array_equal(predicted.to_numpy(), expected(published, trajectory))
    assert predicted.index.tolist() == list(range(N_MEASURED, N_MEASURED + HORIZON))


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rows: rows.drop(columns="a_slide"), "a_slide"),
        (
            lambda rows: rows.iloc[N_MEASURED - LAGS - 1 :],
            f"{LAGS + 1} rows are measured; this model needs {LAGS + 2}",
        ),
        (lambda rows: rows.assign(a_lift=np.nan), "a command, is missing"),
        (lambda rows: rows.iloc[::-1], "must follow the measured ones"),
    ],
)
def test_rows_that_cannot_be_predicted_are_refused(published, asked, change, words):
    mlflow.set_tracking_uri(published[0])
    loaded = mlflow.pyfunc.load_model("models:/kan_dqdot/1")
    with pytest.raises(Exception, match=words):
        loaded.predict(change(asked[1]))


def test_nothing_is_published_without_tracking(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    model = DynamicsModel(make_specification("mlp", "dq"))
    with track("identify", TrackingConfiguration(False, "", None, ""), {}, "") as run:
        publish_dynamics_model(run, tmp_path / "model", model, "mlp_dq", random_trajectory(1, 60))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_loads_in_a_fresh_environment(published, asked, tmp_path):
    """A virtual environment with what the model says that it needs, and nothing else; another folder."""
    trajectory, rows = asked
    uri = published[0]
    mlflow.set_tracking_uri(uri)
    requirements = mlflow.pyfunc.get_model_dependencies("models:/kan_dqdot/2")
    made = subprocess.run([UV, "venv", "--quiet", tmp_path / "venv"], capture_output=True, text=True)
    install = [UV, "pip", "install", "--quiet", "--python", tmp_path / "venv/bin/python", "-r", requirements]
    if made.returncode == 0:
        made = subprocess.run(install, capture_output=True, text=True)
    if made.returncode != 0 and "fetch" in made.stderr + made.stdout:
        pytest.skip("no package index can be reached and uv's cache lacks the packages")
    assert made.returncode == 0, made.stderr
    rows.to_csv(tmp_path / "rows.csv", index=False)
    script = (
        "import mlflow, pandas\n"
        f"mlflow.set_tracking_uri('{uri}')\n"
        "predicted = mlflow.pyfunc.load_model('models:/kan_dqdot/2').predict(pandas.read_csv('rows.csv'))\n"
        "predicted.to_csv('predicted.csv', index=False)\n"
    )
    subprocess.run(
        [tmp_path / "venv/bin/python", "-c", script], cwd=tmp_path, check=True, capture_output=True, text=True
    )
    predicted = pandas.read_csv(tmp_path / "predicted.csv").to_numpy()
    np.testing.assert_allclose(predicted, expected(published, trajectory), rtol=0, atol=1e-6)


@pytest.mark.long
def test_before_and_after_stand_side_by_side(empty_store, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(empty_store, tmp_path / "mlflow.db")
    uri = f"sqlite:///{tmp_path}/mlflow.db"
    model = DynamicsModel(make_specification("mlp", "dqdot"))
    parameters, trajectory = model.initialise(jax.random.key(5)), random_trajectory(3, 60)
    n = model.specification.n_joint
    setting = Setting(model.specification.dt_s, -np.ones(n), np.ones(n), np.ones(n))
    halved = {"ratio_positive": np.full(n, 0.5), "ratio_negative": np.full(n, 0.5)}
    with track(
        "close_loop",
        TrackingConfiguration(True, uri, str(tmp_path / "mlruns"), "loop"),
        {"machine": {"name": "m"}},
        "",
    ) as run:
        for part in ("before", "after"):
            save_model(tmp_path / part, model, parameters, {}, {}, {})
            if part == "after":
                later = {"gain": dict.fromkeys(range(n), 2**62)}
                save_effects(tmp_path / part, ActiveEffects(setting, {"gain": halved}, later))
            publish_dynamics_model(
                run, tmp_path / part, model, "m-closed_loop", trajectory, f"model_{part}", part
            )
    mlflow.set_tracking_uri(uri)
    rows = example_rows(model, trajectory, N_MEASURED, HORIZON)
    starts, effects = np.array([N_MEASURED - 1]), ActiveEffects(setting, {"gain": halved}, {})
    positions = {
        "before": LearnedPredictor(model, parameters).predict(trajectory, starts, HORIZON)[0],
        # the effect acts though its onset lies far in the future
        "after": predictor(model, parameters, effects).predict(trajectory, starts, HORIZON)[0],
    }
    assert np.abs(positions["after"] - positions["before"]).max() > 1e-3
    for alias, expected_positions in positions.items():
        loaded = mlflow.pyfunc.load_model(f"models:/m-closed_loop@{alias}")
        np.testing.assert_allclose(loaded.predict(rows).to_numpy(), expected_positions, atol=1e-6)
