"""Signals of the machine's joints in CAN frames, by a DBC file."""

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from pathlib import Path

import cantools
import numpy as np
from bitstruct import Error as BitError
from cantools.database import Database, Message
from cantools.database.errors import Error as CantoolsError

from pipeline.errors import InputError, first_line
from pipeline.machine.log_sources import per_joint
from pipeline.machine.specification import MachineSpecification, can_database

LISTED = 24


FrameKey = tuple[int, bool]  # identifier, and whether it has 29 bits


class JointSignals:
    """Which signals of which frames hold one number per joint.

    Attributes:
        frames: The frames, reduced to these signals, since others may overlap; one that is multiplexed stands once for
            each multiplexer value that selects such signals.
        joints: For each frame the joints of its signals, as positions in the machine's order.
        n_joint: Their number.
        numbers: Places in `frames` by the frame's key.
    """

    def __init__(self, signals: Sequence[tuple[Message, str]]) -> None:
        groups: dict[tuple, tuple[Message, list[str], list[int]]] = {}
        for joint, (frame, name) in enumerate(signals):
            selected = frame.name, tuple(_conditions(frame, name))
            _, names, joints = groups.setdefault(selected, (frame, [], []))
            names.append(name)
            joints.append(joint)
        self.conditions = [conditions for _, conditions in groups]
        self.sources = [names for _, names, _ in groups.values()]
        self.joints = [joints for _, _, joints in groups.values()]
        self.frames = [
            _reduced(frame, [*names, *(name for name, _ in conditions)])
            for (_, conditions), (frame, names, _) in groups.items()
        ]
        self.n_joint = len(signals)
        self.numbers: dict[FrameKey, list[int]] = {}
        for number, frame in enumerate(self.frames):
            self.numbers.setdefault(key_of(frame), []).append(number)

    @property
    def names(self) -> str:
        """The frames' names, in a list for messages."""
        return ", ".join(dict.fromkeys(frame.name for frame in self.frames))

    def values(self, key: FrameKey, data: bytes) -> list[tuple[int, np.ndarray]] | None:
        """Decode one frame's data into physical values.

        Args:
            key: One of `numbers`.
            data: Its bytes.

        Returns:
            For each of `frames` that it is, the place there and a value per joint, NaN for joints of other frames,
            shape (n_joint,), float64; None if the data do not fit.
        """
        found = []
        try:
            for number in self.numbers[key]:
                decoded = self.frames[number].decode_simple(data, decode_choices=False)
                if all(decoded[name] in chosen for name, chosen in self.conditions[number]):
                    values = np.full(self.n_joint, np.nan)
                    values[self.joints[number]] = [decoded[name] for name in self.sources[number]]
                    found.append((number, values))
        except (CantoolsError, BitError, ValueError, TypeError):
            return None
        return found


def _conditions(frame: Message, name: str) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Yield the multiplexers on which a signal depends, each with the values that select it."""
    signal = frame.get_signal_by_name(name)
    while signal.multiplexer_signal is not None:
        yield signal.multiplexer_signal, tuple(signal.multiplexer_ids or ())
        signal = frame.get_signal_by_name(signal.multiplexer_signal)


def _reduced(frame: Message, names: list[str]) -> Message:
    """The frame with some of its signals only, as if they were in every one."""
    signals = [copy(frame.get_signal_by_name(name)) for name in dict.fromkeys(names)]
    for signal in signals:
        signal.is_multiplexer, signal.multiplexer_ids, signal.multiplexer_signal = False, None, None
    extended = frame.is_extended_frame
    return Message(
        frame.frame_id, frame.name, frame.length, signals, is_extended_frame=extended, strict=False
    )


def key_of(frame: Message) -> FrameKey:
    """Return what tells a frame from others on the bus."""
    return frame.frame_id, frame.is_extended_frame


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
        with warnings_handled("cantools", logging.NullHandler()):  # it tells of frames that stand there twice
            database = cantools.database.load_file(path, strict=False)  # signals may overlap
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
        machine: Its section `can` names `FRAME.SIGNAL` per joint.
        key: `positions` or `commands`.

    Raises:
        InputError: A frame or a signal is missing.
    """
    place = f"conf/machine/{machine.name}.yaml: can.{key}"
    entries: Sequence[str] = getattr(machine.can, key)
    names = per_joint(list(entries), machine.joint_names, place)
    return JointSignals([_signal(database, *name.partition(".")[::2], place) for name in names])


def single_signal(database: Database, frame: str, signal: str, place: str) -> JointSignals:
    """Find one signal by the names of its frame and its own; errors as for `joint_signals`."""
    return JointSignals([_signal(database, frame, signal, place)])


def _signal(database: Database, frame: str, signal: str, place: str) -> tuple[Message, str]:
    try:
        message = database.get_message_by_name(frame)
    except KeyError:
        seen = [one.name for one in database.messages]
        raise InputError(f"{place}: no frame `{frame}` in the DBC file; it has {_listed(seen)}") from None
    known = [one.name for one in message.signals]
    if signal not in known:
        raise InputError(f"{place}: frame {frame} has no signal `{signal}`; it has {_listed(known)}")
    return message, signal


@contextmanager
def warnings_handled(library: str, handler: logging.Handler) -> Iterator[None]:
    """Hand the warnings that a library logs to a handler, and to nothing else."""
    logger = logging.getLogger(library)
    propagates, logger.propagate = logger.propagate, False
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.propagate = propagates


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more
