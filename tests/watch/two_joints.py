"""A machine of two joints, and its logs."""

from pathlib import Path

import numpy as np

from pipeline.configuration.load import ControlConfiguration, load_section
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.logs.formats.writer import write_bag
from pipeline.logs.ingest_config import IngestConfig
from pipeline.machine.specification import JointSpecification, MachineSpecification
from pipeline.watch.look import look
from pipeline.watch.settings import WatchConfig
from pipeline.watch.watch_inputs import WatchInputs, WatchSettings

MACHINE = MachineSpecification(
    name="two_joints",
    rate_hz=20.0,
    joints=[JointSpecification("lift", -1.0, 1.0), JointSpecification("turn", -2.0, 2.0)],
)
SPEED, DT_S, DAY_S = np.array([0.4, 0.3]), 0.05, 86_400  # half ranges per second, one after the other
FIRST_S = 1_700_000_000


def settings(machine: MachineSpecification = MACHINE, profile: str = "smoke") -> WatchSettings:
    tracker = load_section("control", ControlConfiguration, profile).loop_tracker
    return WatchSettings(
        machine,
        load_section("ingest", IngestConfig, profile),
        tracker,
        load_section("identify", IdentifyConfig, profile),
        load_section("close_loop", CloseLoopConfig, profile),
        load_section("watch", WatchConfig, profile),
    )


def write_session(
    folder: Path,
    day: int,
    slower: float = 1.0,
    minutes: float = 2.0,
    machine: MachineSpecification = MACHINE,
) -> Path:
    """A bag of random holds; the second joint has this share of its speed on the way down."""
    random, n, n_joint = np.random.default_rng(day), round(minutes * 60.0 / DT_S), machine.n_joint
    middle, half = (machine.upper + machine.lower) / 2, (machine.upper - machine.lower) / 2
    speed, down = np.resize(SPEED, n_joint) * half, np.where(np.arange(n_joint) == 1, slower, 1.0)
    command, q, v = np.zeros((n, n_joint)), np.tile(middle, (n, 1)), np.zeros(n_joint)
    held, left = np.zeros(n_joint), np.zeros(n_joint)
    for row in range(1, n):
        for joint in range(n_joint):
            left[joint] -= 1
            if left[joint] <= 0:
                held[joint], left[joint] = random.choice([-1.0, 0.0, 1.0]), random.integers(6, 40)
            off = q[row - 1, joint] - middle[joint]
            if abs(off) > 0.8 * half[joint]:
                held[joint] = -np.sign(off)
        command[row] = held
        v = v + 0.2 * (speed * held * np.where(held < 0.0, down, 1.0) - v)
        q[row] = q[row - 1] + DT_S * v
    stamps = (FIRST_S + day * DAY_S) * 10**9 + np.arange(n, dtype=np.int64) * round(1e9 * DT_S)
    path = folder / f"day_{day:03d}"
    write_bag(
        path,
        machine,
        joint_state_header_stamp_ns=stamps,
        joint_state_log_time_ns=stamps + 1_000_000,
        joint_names=list(machine.joint_names),
        positions=q + 3e-4 * random.standard_normal(q.shape),
        command_log_time_ns=stamps,
        commands=command.astype(np.int8),
    )
    return path


def paths(root: Path) -> WatchInputs:
    return WatchInputs((root / "nominal").resolve(), root / "sessions", root / "state", root / "output")


def learn(root: Path, machine: MachineSpecification = MACHINE) -> dict[str, object]:
    """Ten nominal sessions in a folder, and a first look, which learns of them; what it says."""
    for day in range(10):
        write_session(root / "nominal", day, machine=machine)
    (root / "sessions").mkdir()
    return look(paths(root), settings(machine))
