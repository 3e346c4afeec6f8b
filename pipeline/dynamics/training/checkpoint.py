"""Checkpoints of a training run with Orbax, from which a killed run resumes.

They serve resuming only: Orbax folders differ from save to save, so `store.py` writes artifacts.
"""

import hashlib
import re
from pathlib import Path
from typing import Generic, TypeVar

import jax
import orbax.checkpoint as ocp

State = TypeVar("State")


class Checkpoints(Generic[State]):
    """The latest state of one run, in a folder named by the run's identity.

    A run with other data, settings or seed has another identity, and so never resumes from this folder.
    """

    def __init__(self, directory: Path | None, identity: str) -> None:
        """Open the run's folder.

        Args:
            directory: Parent of the runs' folders; None keeps no checkpoints.
            identity: Text (or its digest) that determines the run's result.
        """
        self._manager: ocp.CheckpointManager | None = None
        if directory is not None:
            name = hashlib.sha256(identity.encode()).hexdigest()[:16]
            self._manager = ocp.CheckpointManager(
                (directory / name).absolute(),
                options=ocp.CheckpointManagerOptions(
                    max_to_keep=1, enable_async_checkpointing=False, cleanup_tmp_directories=True
                ),
            )

    def restore(self, initial: State) -> State:
        """The latest saved state, or else `initial`; both are the same tree of arrays."""
        if self._manager is None or self._manager.latest_step() is None:
            return initial
        template = jax.tree.map(ocp.utils.to_shape_dtype_struct, initial)
        return self._manager.restore(self._manager.latest_step(), args=ocp.args.StandardRestore(template))

    def save(self, step: int, state: State) -> None:
        """Save the state after `step` epochs and delete the previous one."""
        if self._manager is not None and step != self._manager.latest_step():
            self._manager.save(step, args=ocp.args.StandardSave(state))

    def close(self) -> None:
        """Finish writing."""
        if self._manager is not None:
            self._manager.close()


def is_training(path: Path) -> bool:
    """Whether it is a folder of `Checkpoints`: named by a digest, a folder in it for each epoch kept."""
    is_named = re.fullmatch("[0-9a-f]{16}", path.name) is not None
    return is_named and path.is_dir() and all(entry.name.split(".")[0].isdigit() for entry in path.iterdir())
