"""Machines, configurations and a made-up session that the tests of this layer share."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.configuration.load import load_machine, load_section
from pipeline.logs.formats.writer import write_bag
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.messages.raw_log import TargetPoses
from pipeline.machine.specification import MachineSpecification

REPOSITORY = Path(__file__).resolve().parents[2]
SHARED = REPOSITORY.parent / "shared"


def shared_folder(*parts: str) -> Path:
    folder = SHARED.joinpath(*parts)
    if not folder.exists():
        pytest.skip(f"../shared/{'/'.join(parts)} is not here")
    return folder


@dataclass(frozen=True)
class Session:
    """What `write_bag` takes, in the machine's joint order."""

    stamp_ns: np.ndarray
    log_time_ns: np.ndarray
    q: np.ndarray
    command_ns: np.ndarray
    command: np.ndarray
    targets: TargetPoses | None = None

    def arguments(self, machine: MachineSpecification) -> dict:
        return {
            "joint_state_header_stamp_ns": self.stamp_ns,
            "joint_state_log_time_ns": self.log_time_ns,
            "joint_names": machine.joint_names,
            "positions": self.q,
            "command_log_time_ns": self.command_ns,
            "commands": self.command,
            "target_poses": self.targets,
        }

    def write(self, path: Path, machine: MachineSpecification, **changes) -> Path:
        write_bag(path, machine, **{**self.arguments(machine), **changes})
        return path


def make_session(machine: MachineSpecification, seconds: float = 20.0, seed: int = 0) -> Session:
    """Joints that follow held commands slowly, sampled at 50 Hz with jitter; commands at 20 Hz."""
    rng = np.random.default_rng(seed)
    start = 1_700_000_000_123_456_789
    n_sample, n_command = int(seconds * 50), int(seconds * 20)
    stamp = start + np.arange(n_sample) * 20_000_000 + rng.integers(-2_000_000, 2_000_000, n_sample)
    command = np.repeat(rng.integers(-1, 2, (n_command // 20 + 1, machine.n_joint)), 20, axis=0)[:n_command]
    command_ns = start + 3_000_000 + np.arange(n_command) * 50_000_000
    middle, span = 0.5 * (machine.lower + machine.upper), machine.upper - machine.lower
    phase = np.arange(n_sample)[:, None] * 0.02 * np.linspace(0.3, 0.9, machine.n_joint)
    q = middle + 0.3 * span * np.sin(phase)
    return Session(
        stamp, stamp + rng.integers(800_000, 2_800_000, n_sample), q, command_ns, command.astype(float)
    )


def with_targets(session: Session, n: int = 5) -> Session:
    rng = np.random.default_rng(3)
    quaternion = rng.normal(size=(n, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    time_ns = session.command_ns[0] + np.arange(n) * 1_000_000_000
    return replace(session, targets=TargetPoses(time_ns, rng.normal(size=(n, 3)), quaternion, "base"))


@pytest.fixture(scope="session")
def machine() -> MachineSpecification:
    return load_machine("bobcat_e10")


@pytest.fixture(scope="session")
def continuous_machine() -> MachineSpecification:
    return load_machine("rc_excavator")


@pytest.fixture(scope="session")
def session(machine: MachineSpecification) -> Session:
    return make_session(machine)


@pytest.fixture(scope="session")
def config() -> IngestConfig:
    return load_section("ingest", IngestConfig)


@pytest.fixture(scope="session")
def loop_tracker() -> LoopTrackerConfig:
    return load_section("control.loop_tracker", LoopTrackerConfig)
