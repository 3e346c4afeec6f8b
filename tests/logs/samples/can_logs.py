"""CAN logs of a session, by `python-can`'s writers and the machine's DBC file."""

from pathlib import Path

import can
import cantools
import numpy as np

from pipeline.configuration.load import MACHINE_DIRECTORY
from tests.logs.conftest import Session

WRITERS = {
    ".log": can.CanutilsLogWriter,
    ".asc": can.ASCWriter,
    ".blf": can.BLFWriter,
    ".trc": can.TRCWriter,
    ".csv": can.CSVWriter,
    ".db": can.SqliteWriter,
}
RESOLUTION_S = {".log": 1e-6, ".asc": 1e-6, ".blf": 1e-6, ".trc": 1e-3, ".csv": 1e-6, ".db": 1e-6}
DATABASE = cantools.database.load_file(MACHINE_DIRECTORY / "bobcat_e10.dbc")
POSITION_RESOLUTION_RAD = 9.587379924285257e-05


def frames(session: Session, joint_names) -> list[can.Message]:
    """In order of log time; encoders are timed by their header stamp, as CAN has no other."""
    encoders, commands = DATABASE.get_message_by_name("ENCODERS"), DATABASE.get_message_by_name("COMMAND")
    found = []
    for time_ns, q in zip(session.stamp_ns, session.q, strict=True):
        values = {f"position_{joint}": float(x) for joint, x in zip(joint_names, q, strict=True)}
        found.append((time_ns, encoders.frame_id, encoders.encode(values)))
    for number, (time_ns, a) in enumerate(zip(session.command_ns, session.command, strict=True)):
        values = {f"command_{joint}": int(x) for joint, x in zip(joint_names, a, strict=True)}
        found.append((time_ns, commands.frame_id, commands.encode({**values, "counter": number % 256})))
    return [
        can.Message(
            timestamp=int(time_ns) / 1e9,
            arbitration_id=identifier,
            is_extended_id=False,
            data=data,
            channel=0,
        )
        for time_ns, identifier, data in sorted(found, key=lambda frame: frame[0])
    ]


def write(path: Path, messages: list[can.Message]) -> Path:
    """Write a log in the format of the path's suffix."""
    with WRITERS[path.suffix](path) as writer:
        if path.suffix == ".blf":
            writer.max_container_size = 1 << 12
        elif path.suffix == ".db":  # the writer loses what is left when it has written before it is stopped
            writer.MAX_BUFFER_SIZE_BEFORE_WRITES, writer.MAX_TIME_BETWEEN_WRITES = 1 << 20, 3600.0
        for message in messages:
            writer(message)
    if path.suffix == ".asc":  # its head holds today's date, with one to three digits of milliseconds
        _, rest = path.read_text().split("\n", 1)
        path.write_text(f"date Thu Jan 01 00:00:00.000 2026\n{rest}")
    return path


def rounded_q(session: Session) -> np.ndarray:
    return np.rint(session.q / POSITION_RESOLUTION_RAD) * POSITION_RESOLUTION_RAD
