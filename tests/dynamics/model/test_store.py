"""Model folders: round trip, equal bytes, and one clear line for whatever is wrong with them."""

import csv
import json

import jax
import numpy as np
import pytest
from flax import serialization

from pipeline.dynamics.model.store import load_metadata, load_model, save_model
from pipeline.errors import InputError


def save(model, directory):
    parameters = model.initialise(jax.random.key(1))
    curves = {"epoch": [1.0, 2.0], "training_loss": [0.5, 0.25]}
    save_model(directory, model, parameters, {"machine": "two_joints"}, {"evaluation_loss": 0.1}, curves)
    return parameters


@pytest.fixture
def folder(one_model, tmp_path):
    save(one_model, tmp_path / "model")
    return tmp_path / "model"


def test_round_trip(model, tmp_path):
    directory = tmp_path / "model"
    parameters = save(model, directory)
    loaded, restored = load_model(directory)
    assert loaded.specification == model.specification
    assert jax.tree.structure(restored) == jax.tree.structure(parameters)
    assert jax.tree.all(jax.tree.map(np.array_equal, restored, parameters))
    assert load_metadata(directory) == {"machine": "two_joints"}
    assert json.loads((directory / "metrics.json").read_text()) == {"evaluation_loss": 0.1}
    rows = list(csv.reader((directory / "curves.csv").open()))
    assert rows == [["epoch", "training_loss"], ["1.0", "0.5"], ["2.0", "0.25"]]
    assert sorted(path.name for path in directory.iterdir()) == [
        "curves.csv",
        "meta.json",
        "metrics.json",
        "parameters.msgpack",
    ]


def test_equal_content_gives_equal_bytes(one_model, folder, tmp_path):
    other = tmp_path / "other"
    parameters = one_model.initialise(jax.random.key(1))
    shuffled = {name: dict(reversed(layer.items())) for name, layer in reversed(parameters.items())}
    curves = {"epoch": [1.0, 2.0], "training_loss": [0.5, 0.25]}
    save_model(other, one_model, shuffled, {"machine": "two_joints"}, {"evaluation_loss": 0.1}, curves)
    for path in folder.iterdir():
        assert path.read_bytes() == (other / path.name).read_bytes()


def change_meta(directory, change):
    meta = json.loads((directory / "meta.json").read_text())
    change(meta)
    (directory / "meta.json").write_text(json.dumps(meta))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda d: (d / "meta.json").unlink(), r"meta\.json: No such file"),
        (lambda d: (d / "meta.json").write_text("{"), r"meta\.json: not JSON"),
        (lambda d: (d / "meta.json").write_text("[]"), r"meta\.json: not a JSON object"),
        (lambda d: (d / "meta.json").write_bytes(b"\xff\xfe"), r"meta\.json: not JSON"),
        (lambda d: change_meta(d, lambda m: m.update(schema_version=99)), "schema version 99"),
        (lambda d: change_meta(d, lambda m: m.pop("specification")), "no valid model specification"),
        (lambda d: change_meta(d, lambda m: m["specification"].update(lags=-1)), "lags is -1"),
        (lambda d: change_meta(d, lambda m: m["specification"].update(lags=7)), "do not fit"),
        (lambda d: change_meta(d, lambda m: m["specification"].update(hidden=[3])), "do not fit"),
        (lambda d: change_meta(d, lambda m: m["specification"].update(target="x")), "no valid model"),
        (lambda d: (d / "parameters.msgpack").unlink(), r"parameters\.msgpack: No such file"),
        (lambda d: (d / "parameters.msgpack").write_bytes(b"123"), "damaged"),
    ],
)
def test_damaged_folders_are_refused_in_one_line(folder, damage, message):
    damage(folder)
    with pytest.raises(InputError, match=message) as error:
        load_model(folder)
    assert "\n" not in str(error.value)


def test_parameters_are_readable_by_flax_alone(one_model, folder):
    parameters = one_model.initialise(jax.random.key(1))
    restored = serialization.msgpack_restore((folder / "parameters.msgpack").read_bytes())
    assert jax.tree.all(jax.tree.map(np.array_equal, restored, parameters))
