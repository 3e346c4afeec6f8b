"""The machine's CAN frames, by its DBC file: `conf/machine/<name>.dbc`.

Signals are named after the machine's joints: `command_<joint>`, `position_<joint>`.
"""

import dataclasses
from pathlib import Path

import cantools
import numpy as np

from pipeline.deployment.messages import CanFrame
from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification

COUNTER_STEPS = 256


class CanFrames:
    """Conversion of commands, emergencies and encoder readings to and from frames."""

    def __init__(self, machine: MachineSpecification, directory: Path) -> None:
        """The frames of a machine whose DBC file lies in `directory`.

        Raises:
            InputError: the file is missing, unreadable, or lacks a frame or a joint's signal.
        """
        path = Path(directory) / f"{machine.name}.dbc"
        try:
            database = cantools.database.load_file(path)
            assert isinstance(database, cantools.database.Database)
            self._emergency = database.get_message_by_name("EMERGENCY")
            self._command = database.get_message_by_name("COMMAND")
            names = {frame.name for frame in database.messages}
            self._release = database.get_message_by_name("RELEASE") if "RELEASE" in names else None
            self._encoders = database.get_message_by_name("ENCODERS")
        except FileNotFoundError:
            raise InputError(f"{path}: no such file; describe the machine's CAN frames there") from None
        except KeyError as error:
            raise InputError(f"{path}: no frame {error}; it must define it") from None
        except cantools.database.UnsupportedDatabaseFormatError as error:
            raise InputError(f"{path}: not a DBC file ({error})") from None
        self._joints = machine.joint_names
        for frame, prefix in ((self._command, "command"), (self._encoders, "position")):
            names = {signal.name for signal in frame.signals}
            for joint in self._joints:
                if f"{prefix}_{joint}" not in names:
                    raise InputError(f"{path}: frame {frame.name} has no signal {prefix}_{joint}")

    def command(self, values: np.ndarray, counter: int, now_ns: int) -> CanFrame:
        """Frame of a valid command, (n_joint,)."""
        signals = {f"command_{name}": int(v) for name, v in zip(self._joints, values, strict=True)}
        data = self._command.encode({**signals, "counter": counter % COUNTER_STEPS})
        return CanFrame(now_ns, self._command.frame_id, data)

    def emergency(self, now_ns: int) -> CanFrame:
        """Frame that zeroes the outputs."""
        return CanFrame(now_ns, self._emergency.frame_id, self._emergency.encode({"stop": 1}))

    def release(self, now_ns: int) -> CanFrame | None:
        """Frame that ends a stop; None if the machine has no such frame and is restarted instead."""
        if self._release is None:
            return None
        return CanFrame(now_ns, self._release.frame_id, self._release.encode({"release": 1}))

    def encoders(self, position: np.ndarray, now_ns: int) -> CanFrame:
        """Frame of encoder readings, rad, (n_joint,)."""
        signals = {f"position_{name}": float(v) for name, v in zip(self._joints, position, strict=True)}
        return CanFrame(now_ns, self._encoders.frame_id, self._encoders.encode(signals))

    def read_command(self, frame: CanFrame) -> np.ndarray | None:
        """The command in a frame, (n_joint,); None for other frames and for frames of a wrong length."""
        return self._read(frame, self._command, "command")

    def read_encoders(self, frame: CanFrame) -> np.ndarray | None:
        """The readings in a frame, rad, (n_joint,); None for other frames and for frames of a wrong length."""
        return self._read(frame, self._encoders, "position")

    def is_emergency(self, frame: CanFrame) -> bool:
        """Whether the frame zeroes the outputs, whatever its content: in doubt, stop."""
        return frame.identifier == self._emergency.frame_id

    def is_release(self, frame: CanFrame) -> bool:
        """Whether the frame ends a stop; only the exact frame does."""
        return self._release is not None and dataclasses.replace(frame, stamp_ns=0) == self.release(0)

    def _read(self, frame: CanFrame, message: cantools.database.Message, prefix: str) -> np.ndarray | None:
        if frame.identifier != message.frame_id or len(frame.data) != message.length:
            return None
        signals = message.decode(frame.data)
        assert isinstance(signals, dict)
        return np.array([signals[f"{prefix}_{name}"] for name in self._joints], np.float64)
