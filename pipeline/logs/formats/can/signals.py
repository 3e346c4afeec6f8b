"""Signals of the machine's joints in CAN frames, by a DBC file."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cantools
import numpy as np
from bitstruct import Error as BitError
from cantools.database import Database, Message
from cantools.database.errors import Error as CantoolsError

from pipeline.errors import InputError, first_line
from pipeline.machine.specification import MachineSpecification, can_database, per_joint

LISTED = 24


@dataclass(frozen=True)
class JointSignals:
    """Which signals of which frames hold one number per joint.

    Attributes:
        frames: The frames, each once.
        sources: For each frame the names of its signals.
        joints: For each frame the joints of these signals, as positions in the machine's order.
    """

    frames: list[Message]
    sources: list[list[str]]
    joints: list[list[int]]

    def values(self, number: int, data: bytes) -> np.ndarray | None:
        """Decode one frame's data into physical values, shape (n_signals,), float64; None if they do not fit.

        Args:
            number: Which of `frames`.
            data: Its bytes.
        """
        try:
            decoded = self.frames[number].decode_simple(data, decode_choices=False)
            return np.array([decoded[name] for name in self.sources[number]], np.float64)
        except (CantoolsError, BitError, KeyError, ValueError, TypeError):
            return None


def load_database(machine: MachineSpecification) -> Database:
    """Read the machine's DBC file.

    Raises:
        InputError: It is missing or cannot be read.
    """
    return load_database_file(can_database(machine))


def load_database_file(path: Path) -> Database:
    """Read a DBC file.

    Raises:
        InputError: It is missing or cannot be read.
    """
    try:
        database = cantools.database.load_file(path)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; name the DBC file in can.database of the machine") from error
    except (CantoolsError, OSError, ValueError) as error:
        reason = first_line(error)
        raise InputError(f"{path}: not a DBC file ({reason})") from error
    if not isinstance(database, Database):
        raise InputError(f"{path}: describes diagnostics, not frames; name a DBC file")
    return database


def joint_signals(database: Database, machine: MachineSpecification, key: str) -> JointSignals:
    """Find the signals that the machine's configuration names.

    Args:
        database: The frames.
        machine: Its section `can` names `FRAME.SIGNAL` per joint.
        key: `positions` or `commands`.

    Raises:
        InputError: A frame or a signal is missing.
    """
    place = f"conf/machine/{machine.name}.yaml: can.{key}"
    entries: Sequence[str] = getattr(machine.can, key)
    found: dict[str, tuple[list[str], list[int]]] = {}
    for joint, entry in enumerate(per_joint(list(entries), machine.joint_names, place)):
        frame, _, signal = entry.partition(".")
        names, joints = found.setdefault(frame, ([], []))
        names.append(signal)
        joints.append(joint)
    frames = []
    for frame, (names, _) in found.items():
        try:
            message = database.get_message_by_name(frame)
        except KeyError:
            seen = [one.name for one in database.messages]
            raise InputError(f"{place}: no frame `{frame}` in the DBC file; it has {_listed(seen)}") from None
        known = [signal.name for signal in message.signals]
        if missing := [name for name in names if name not in known]:
            raise InputError(f"{place}: frame {frame} has no signal `{missing[0]}`; it has {_listed(known)}")
        frames.append(message)
    return JointSignals(
        frames, [names for names, _ in found.values()], [joints for _, joints in found.values()]
    )


def single_signal(database: Database, frame: str, signal: str) -> JointSignals | None:
    """Find one signal by the names of its frame and its own; None if the DBC file lacks it."""
    try:
        message = database.get_message_by_name(frame)
    except KeyError:
        return None
    return (
        JointSignals([message], [[signal]], [[0]])
        if signal in {one.name for one in message.signals}
        else None
    )


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more
