"""What was learned of nominal logs as a file, for all that is measured later: most of the time of a loop goes into it.

The file says what it was learned from, and by which settings and code. Of anything else it is no answer.
"""

import hashlib
import io
import json
import tokenize
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from flax import serialization

from pipeline.discrepancy.diagnosis.diagnosis_model import DiagnosisModel, training_of_diagnosis
from pipeline.discrepancy.diagnosis.nominal.fingerprint import code_fingerprint
from pipeline.discrepancy.selection.candidate import Candidate, Misfit, Nominal
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.model.fir.model import FirModel
from pipeline.dynamics.model.fir.specification import FirSpecification
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.errors import InputError
from pipeline.files.atomic import write_whole
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification

# What NumPy and zipfile raise for bytes that are not what they were.
DAMAGES = (
    OSError,
    EOFError,
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    NotImplementedError,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)


class Learned(NamedTuple):
    """What takes time to learn of nominal logs.

    Attributes:
        diagnosis: Speeds from commands and positions.
        null: What each candidate gains though there is nothing to be found.
        present: Families of effects that the logs show themselves.
    """

    diagnosis: DiagnosisModel
    null: Nominal
    present: tuple[str, ...]


def identity(
    nominal: Sequence[Trajectory],
    machine: MachineSpecification,
    config: CloseLoopConfig,
    identify: IdentifyConfig,
) -> str:
    """Of all that it follows from: logs, machine, settings and code."""
    settings = {"seed": config.seed, "search": asdict(config.search)}
    settings |= {"identify": asdict(replace(identify, selected={"": training_of_diagnosis(identify)}))}
    settings |= {"dt_s": machine.dt_s, "command_kind": machine.command_kind, "code": code_fingerprint()}
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True).encode())
    columns = [machine.lower, machine.upper]
    columns += [column for t in nominal for column in (t.q, t.qd, t.a, t.t_s, t.stamp_ns, t.is_validation)]
    for column in columns:
        digest.update(f"{column.shape} {column.dtype}".encode() + np.ascontiguousarray(column).tobytes())
    return digest.hexdigest()


def save_learned(path: Path, learned: Learned, known_as: str) -> None:
    """Write the file; `known_as` is the `identity` of what it was learned from.

    Raises:
        InputError: It cannot be written.
    """
    diagnosis = learned.diagnosis
    content = {
        "identity": known_as,
        "specification": asdict(diagnosis.model.specification),
        "present": learned.present,
        "null": [_to_content(misfit) for misfit in learned.null.values()],
    }
    parameters = serialization.msgpack_serialize(jax.tree.map(np.asarray, diagnosis.parameters))
    arrays: dict[str, Any] = {"left_out": diagnosis.left_out}
    arrays["parameters"] = np.frombuffer(parameters, np.uint8)
    arrays["content"] = np.frombuffer(json.dumps(content).encode(), np.uint8)
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    write_whole(path, file.getbuffer())


def load_learned(path: Path, known_as: str) -> Learned | None:
    """Read the file; None where there is none, or where it is of something else.

    Raises:
        InputError: It is damaged.
    """
    if not path.exists():
        return None
    try:
        with np.load(path, allow_pickle=False) as arrays:
            content = json.loads(arrays["content"].tobytes())
            if content["identity"] != known_as:
                return None
            parameters = serialization.msgpack_restore(arrays["parameters"].tobytes())
            model = FirModel(FirSpecification(**content["specification"]))
            diagnosis = DiagnosisModel(model, jax.tree.map(jax.numpy.asarray, parameters), arrays["left_out"])
            misfits = [_from_content(of) for of in content["null"]]
            present = tuple(content["present"])
    except DAMAGES as error:
        raise InputError(
            f"{path}: not readable as what was learned of nominal logs ({error}); delete it"
        ) from error
    return Learned(diagnosis, {misfit.candidate.key: misfit for misfit in misfits}, present)


def without(null: Nominal, excluded: Sequence[str]) -> Nominal:
    """The same as if the excluded families had not been tried."""
    return {key: misfit for key, misfit in null.items() if key[0] not in excluded}


def _to_content(misfit: Misfit) -> dict[str, Any]:
    c = misfit.candidate
    arrays = {"coefficients": c.coefficients.tolist(), "gain_by_block": c.gain_by_block.tolist()}
    values = {"family": c.family, "joint": c.joint, "source": c.source, "point": dict(c.point)}
    values |= {"freed": c.freed, "gain": c.gain, "share": c.share, "owed": c.owed}
    return {"candidate": values | arrays, "most_per_row": misfit.most_per_row}


def _from_content(content: dict[str, Any]) -> Misfit:
    values = content["candidate"]
    freed = tuple(
        tuple((name, tuple(index) if isinstance(index, list) else index) for name, index in of)
        for of in values["freed"]
    )
    arrays = {name: np.array(values[name]) for name in ("coefficients", "gain_by_block")}
    return Misfit(Candidate(**(values | arrays | {"freed": freed})), content["most_per_row"])
