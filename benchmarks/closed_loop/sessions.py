"""Sessions of a simulated machine, as bags or as the trajectories that ingest makes of such bags."""

from dataclasses import dataclass
from datetime import datetime
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.closed_loop.simulator import MACHINE, Machine, Simulator
from pipeline.configuration.load import ControlConfiguration, load_machine, load_section
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.messages.raw_log import RawLog
from pipeline.logs.trajectories import make_trajectories
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.recording.session import NANOSECONDS, SessionLog
from pipeline.testbench.recording import write_session

PROFILE = "default"


@dataclass(frozen=True)
class Session:
    """All that a recording depends on.

    Attributes:
        simulator: Of the machine.
        parameters: The machine at the start.
        changes: Later ones, each with the time from which on they hold, s.
        style_seed: Of the operator's habits.
        seed: Of the session's chances.
        minutes: Duration.
        start: When; gives the bag its name.
    """

    simulator: Simulator
    parameters: Machine
    changes: tuple[tuple[float, Machine], ...]
    style_seed: int
    seed: int
    minutes: float
    start: datetime

    @property
    def name(self) -> str:
        """The bag's name."""
        return self.start.strftime("%Y-%m-%d-%H-%M-%S")

    @property
    def specification(self) -> MachineSpecification:
        """Of the machine."""
        return self.simulator.specification(self.parameters)

    def record(self) -> SessionLog:
        """Let the operator work."""
        return self.simulator.record(
            self.parameters,
            self.changes,
            self.style_seed,
            self.minutes,
            self.seed,
            int(self.start.timestamp()) * NANOSECONDS,
        )


@cache
def machine() -> MachineSpecification:
    """The machine whose joints the plant and the kinematic simulator have."""
    return load_machine(MACHINE)


@cache
def ingest_settings() -> tuple[IngestConfig, LoopTrackerConfig]:
    """Settings that the stage ingest has by default."""
    control = load_section("control", ControlConfiguration, PROFILE)
    return load_section("ingest", IngestConfig, PROFILE), control.loop_tracker


def write(session: Session, folder: Path) -> None:
    """Record a session into a bag in `folder`."""
    write_session(folder / session.name, session.specification, session.record())


def trajectories(session: Session) -> list[Trajectory]:
    """Record a session and make of it what ingest makes of its bag."""
    log = session.record()
    joints = np.argsort(log.joint_state_log_time_ns, kind="stable")  # the order in which a bag holds messages
    commands = np.argsort(log.command_log_time_ns, kind="stable")
    raw = RawLog(
        name=session.name,
        path=Path(session.name),
        joint_stamp_ns=log.joint_state_header_stamp_ns[joints],
        joint_log_time_ns=log.joint_state_log_time_ns[joints],
        q=log.positions[joints],
        command_log_time_ns=log.command_log_time_ns[commands],
        command=log.commands[commands].astype(np.float64),
    )
    return make_trajectories(raw, session.specification, *ingest_settings()).trajectories
