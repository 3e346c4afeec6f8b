"""Checkpoints of a training: one file, replaced atomically at every point of the learning curve."""

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np
from flax import serialization

from pipeline.control.curve import CurvePoint
from pipeline.control.policy import Policy, policy_from_content, policy_to_content
from pipeline.errors import InputError
from pipeline.files.atomic import write_whole
from pipeline.reaching.metrics import ReachingMetrics

_CHECKPOINT_FILE = "checkpoint.msgpack"


@dataclass(frozen=True)
class Checkpoint:
    """State of a training.

    Attributes:
        steps: steps trained so far.
        state: all arrays of the training and of its episodes, in their order; None before the first step.
        curve: learning curve so far.
        kept: the policy kept as the training's result, with its steps; None before that point.
    """

    steps: int
    state: list[np.ndarray] | None
    curve: list[CurvePoint]
    kept: tuple[Policy, int] | None


def identity(*parts: Any) -> str:
    """Hash of a training's inputs: numbers, strings and arrays, nested in dicts, lists and tuples."""
    digest = hashlib.sha256()
    leaves, structure = jax.tree.flatten(parts)
    digest.update(str(structure).encode())
    for leaf in leaves:
        content = np.asarray(leaf)
        digest.update(f"{content.dtype.str}{content.shape}".encode())
        digest.update(content.tobytes())
    return digest.hexdigest()


def is_checkpoint(path: Path) -> bool:
    """Whether `save_checkpoint` wrote the file."""
    return path.name == _CHECKPOINT_FILE


def save_checkpoint(directory: Path, training: str, checkpoint: Checkpoint) -> None:
    """Replace the directory's checkpoint.

    Args:
        directory: created if missing.
        training: `identity` of the training.
        checkpoint: its state.
    """
    kept = checkpoint.kept
    content = {
        "training": training,
        "steps": checkpoint.steps,
        "state": None if checkpoint.state is None else serialization.to_state_dict(checkpoint.state),
        "curve": json.dumps([asdict(point) for point in checkpoint.curve]),
        "kept": None if kept is None else {"policy": policy_to_content(kept[0]), "steps": kept[1]},
    }
    write_whole(Path(directory) / _CHECKPOINT_FILE, serialization.msgpack_serialize(content))


def load_checkpoint(directory: Path, training: str) -> Checkpoint | None:
    """The directory's checkpoint; None if it is missing or belongs to another training.

    Args:
        directory: directory of `save_checkpoint`.
        training: `identity` of the resuming training.

    Raises:
        InputError: the file is damaged, or `save_checkpoint` did not write it.
    """
    path = Path(directory) / _CHECKPOINT_FILE
    if not path.exists():
        return None
    try:
        content = serialization.msgpack_restore(path.read_bytes())
    except ValueError as error:
        raise InputError(f"{path}: not readable as a checkpoint ({error}); delete it to train anew") from None
    if not isinstance(content, dict) or "training" not in content:
        raise InputError(f"{path}: not a checkpoint of a training; name another folder for checkpoints")
    if content["training"] != training or "state" not in content:  # old checkpoints lack it
        return None
    kept, state = content["kept"], content["state"]
    return Checkpoint(
        steps=content["steps"],
        state=None if state is None else [state[str(index)] for index in range(len(state))],
        curve=[
            CurvePoint(point["steps"], ReachingMetrics(**point["metrics"]))
            for point in json.loads(content["curve"])
        ],
        kept=None if kept is None else (policy_from_content(kept["policy"]), kept["steps"]),
    )


def restored_like(template: Any, leaves: list[np.ndarray]) -> Any:
    """The arrays of a checkpoint in the structure that the training has now.

    Raises:
        InputError: they are not of that structure.
    """
    expected, structure = jax.tree.flatten(template)
    kinds = [(np.shape(leaf), np.asarray(leaf).dtype) for leaf in expected]
    if kinds != [(leaf.shape, leaf.dtype) for leaf in leaves]:
        raise InputError(
            "the checkpoint holds another state than the training has here (versions or devices differ); "
            "delete the folder of checkpoints to train anew"
        )
    return jax.tree.unflatten(structure, [jax.numpy.asarray(leaf) for leaf in leaves])
