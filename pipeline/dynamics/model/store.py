"""A model folder: `parameters.msgpack`, `meta.json`, `metrics.json`, `curves.csv`; byte-stable."""

import csv
import dataclasses
import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
from flax import serialization

from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.kinds import build_model, read_specification
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.model.specify import check_machine
from pipeline.errors import InputError
from pipeline.files.atomic import write_json, write_whole
from pipeline.machine.specification import MachineSpecification

SCHEMA_VERSION = 1
MODEL_FOLDER = "model_folder"  # artifact of a registered model: a served model imports nothing of tracking


def save_model(
    directory: Path,
    model: DynamicsModel,
    parameters: Parameters,
    metadata: Mapping[str, Any],
    metrics: Mapping[str, Any],
    curves: Mapping[str, Sequence[float]],
) -> None:
    """Write a model folder; each file appears whole or not at all, `meta.json` last.

    Args:
        directory: Created where absent.
        model: The dynamics model.
        parameters: θ.
        metadata: JSON-able lineage and configuration, kept under `metadata` in `meta.json`.
        metrics: Flat figures for `metrics.json`.
        curves: Columns of equal length for `curves.csv`.
    """
    # Through a tree map, which orders the keys: equal parameters give equal bytes.
    content = serialization.msgpack_serialize(jax.tree.map(np.asarray, parameters))
    write_whole(directory / "parameters.msgpack", content)
    write_json(directory / "metrics.json", dict(metrics), sort_keys=True, allow_nan=False)
    write_whole(directory / "curves.csv", _csv(curves))
    meta = {
        "schema_version": SCHEMA_VERSION,
        "specification": dataclasses.asdict(model.specification),
        "parameters_sha256": hashlib.sha256(content).hexdigest(),
        "metadata": dict(metadata),
    }
    write_json(directory / "meta.json", meta, sort_keys=True, allow_nan=False)


def load_model(directory: Path) -> tuple[DynamicsModel, Parameters]:
    """Read a model folder.

    Raises:
        InputError: if it is none, was written by another version, or is damaged.
    """
    meta = _read_meta(directory)
    version = meta.get("schema_version")
    if version != SCHEMA_VERSION:
        raise InputError(
            f"{directory}/meta.json: schema version {version}, this program reads {SCHEMA_VERSION}; "
            "identify again"
        )
    try:
        content = (directory / "parameters.msgpack").read_bytes()
    except OSError as error:
        raise InputError(f"{directory}/parameters.msgpack: {error.strerror}; identify again") from error
    if hashlib.sha256(content).hexdigest() != meta.get("parameters_sha256"):
        raise InputError(
            f"{directory}/parameters.msgpack: not what meta.json describes (damaged?); identify again"
        )
    try:
        model = build_model(read_specification(meta["specification"]))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{directory}/meta.json: no valid model specification ({error}); identify again"
        ) from error
    parameters = serialization.msgpack_restore(content)
    expected = jax.eval_shape(model.initialise, jax.random.key(0))
    if jax.tree.map(np.shape, parameters) != jax.tree.map(np.shape, expected):
        raise InputError(f"{directory}: parameters do not fit the specification in meta.json; identify again")
    return model, jax.tree.map(jax.numpy.asarray, parameters)


def load_model_of(directory: Path, machine: MachineSpecification) -> tuple[DynamicsModel, Parameters]:
    """Read a model folder that must be of this machine.

    Raises:
        InputError: As `load_model`, or the model is of another machine.
    """
    model, parameters = load_model(directory)
    check_machine(model.specification, machine, str(directory))
    return model, parameters


def model_fingerprint(directory: Path) -> str:
    """Digest of the model's parameters, as `meta.json` states it.

    Raises:
        InputError: as `load_model`.
    """
    return str(_read_meta(directory).get("parameters_sha256"))


def load_metadata(directory: Path) -> dict[str, Any]:
    """The `metadata` that `save_model` was given."""
    return _read_meta(directory).get("metadata", {})


def _read_meta(directory: Path) -> dict[str, Any]:
    try:
        meta = json.loads((directory / "meta.json").read_text())
    except OSError as error:
        raise InputError(
            f"{directory}/meta.json: {error.strerror}; give the folder that identify wrote"
        ) from error
    except ValueError as error:
        raise InputError(f"{directory}/meta.json: not JSON ({error}); identify again") from error
    if not isinstance(meta, dict):
        raise InputError(f"{directory}/meta.json: not a JSON object; identify again")
    return meta


def _csv(columns: Mapping[str, Sequence[float]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return text.getvalue().encode()
