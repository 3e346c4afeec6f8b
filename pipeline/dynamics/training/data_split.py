"""Which rows are for learning and which for judgement; no row is for both."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import InputError
from pipeline.logs.tuples import SUFFIX, Trajectory, read_tuples, validation_part
from pipeline.machine.specification import MachineSpecification

HELD_OUT, VALIDATION = "held_out", "validation"


@dataclass(frozen=True)
class Purposes:
    """Trajectories by what they are for.

    Attributes:
        learning: To learn from, with their validation rows for early stopping and selection.
        judged: To judge on.
        judged_on: `held_out`, or `validation` where nothing was held out: rows that early stopping saw.
    """

    learning: list[Trajectory]
    judged: list[Trajectory]
    judged_on: str


def split_by_purpose(
    tuples: Path, held_out: Path | None, hold_out: Sequence[str], machine: MachineSpecification
) -> Purposes:
    """Read tuples and split them by purpose.

    Args:
        tuples: Folder to learn from.
        held_out: Folder of recordings that nothing learns from; it may be empty.
        hold_out: Names of trajectories in `tuples` to keep for judgement instead.
        machine: The machine.

    Raises:
        InputError: A folder or a trajectory is missing, or nothing is left to learn from.
    """
    learning = read_tuples(tuples, machine)
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
    if held_out is not None and not held_out.is_dir():
        raise InputError(f"held_out={held_out}: no such folder; run the stage ingest with this output")
    if held_out is not None and any(held_out.glob(f"*{SUFFIX}")):
        judged += read_tuples(held_out, machine)
    if judged:
        return Purposes(learning, judged, HELD_OUT)
    return Purposes(learning, [validation_part(trajectory) for trajectory in learning], VALIDATION)
