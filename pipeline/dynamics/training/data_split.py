"""Split of the data into training and test rows, which are disjoint."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import InputError
from pipeline.logs.tuples import SUFFIX, Trajectory, read_tuples, validation_part
from pipeline.machine.specification import MachineSpecification

HELD_OUT, VALIDATION = "held_out", "validation"
JUDGED_ROWS = {HELD_OUT: "held-out rows", VALIDATION: "validation rows, which early stopping saw"}


@dataclass(frozen=True)
class DataSplit:
    """Trajectories by purpose.

    Attributes:
        learning: Training data, with their validation rows for early stopping and selection.
        judged: Test data.
        judged_on: `held_out`, or `validation` without held-out data: rows that early stopping used.
    """

    learning: list[Trajectory]
    judged: list[Trajectory]
    judged_on: str


def split_by_purpose(
    tuples: str | Path,
    held_out: str | Path | None,
    hold_out: Sequence[str],
    machine: MachineSpecification,
) -> DataSplit:
    """Read tuples and split them by purpose.

    Args:
        tuples: Folder of the training data.
        held_out: Folder of held-out recordings; it may be empty.
        hold_out: Names of trajectories in `tuples` to hold out instead.

    Raises:
        InputError: A folder or a trajectory is missing, or no training data are left.
    """
    learning = read_tuples(Path(tuples), machine)
    names = [trajectory.name for trajectory in learning]
    unknown = [name for name in hold_out if name not in names]
    if unknown:
        raise InputError(f"hold_out={unknown}: no such trajectory in {tuples}; it has {', '.join(names)}")
    judged = [trajectory for trajectory in learning if trajectory.name in hold_out]
    learning = [trajectory for trajectory in learning if trajectory.name not in hold_out]
    if not learning:
        raise InputError(
            f"hold_out={list(hold_out)}: nothing is left to learn from; hold out fewer trajectories"
        )
    if held_out is not None and not Path(held_out).is_dir():
        raise InputError(f"held_out={held_out}: no such folder; run the stage ingest with this output")
    if held_out is not None and any(Path(held_out).glob(f"*{SUFFIX}")):
        judged += read_tuples(Path(held_out), machine)
    if judged:
        return DataSplit(learning, judged, HELD_OUT)
    return DataSplit(learning, [validation_part(trajectory) for trajectory in learning], VALIDATION)
