"""The MuJoCo arm as a simulator of the benchmark."""

from collections.abc import Sequence
from zlib import crc32

import numpy as np

from benchmarks.closed_loop import simulator
from benchmarks.closed_loop.kinematic.effects import Effect
from benchmarks.closed_loop.machines import Variant
from benchmarks.closed_loop.mujoco_arm import effects
from benchmarks.closed_loop.mujoco_arm.arm import Arm, draw_arm
from benchmarks.closed_loop.mujoco_arm.operator import sticks
from benchmarks.closed_loop.mujoco_arm.session import PERIOD_S, begin, record_session
from benchmarks.closed_loop.stretches import replay
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.recording.session import SessionLog


class MujocoJoints(simulator.Simulator):
    """Cylinders on rigid bodies; see `benchmarks.closed_loop.mujoco_arm`."""

    name = "mujoco"
    variant_name = "mujoco_variant"
    entropy = (crc32(name.encode()),)
    outside = tuple(effects.OUTSIDE)
    largest_size = effects.LARGEST_SIZE

    def specification(self, machine: Arm) -> MachineSpecification:
        """See `Simulator`."""
        return machine.specification

    def drawn_machine(self, seed: int) -> Arm:
        """See `Simulator`."""
        return draw_arm(seed)

    def draw_effect(self, kind: str, seed: int, variant: Variant, size: float) -> Effect:
        """See `Simulator`."""
        return effects.draw(kind, seed, variant.parameters, size)

    def record(
        self,
        machine: Arm,
        changes: Sequence[tuple[float, Arm]],
        style_seed: int,
        minutes: float,
        seed: int,
        start_time_ns: int,
    ) -> SessionLog:
        """See `Simulator`."""
        at_sticks = sticks(machine.specification, style_seed, seed)
        return record_session(machine, at_sticks, minutes, seed, start_time_ns, changes)

    def replay(
        self,
        machine: Arm,
        log: SessionLog,
        session_seed: int,
        starts: Sequence[int],
        horizon: int,
        seed: int,
        changes: Sequence[tuple[float, Arm]] = (),
        instead: Sequence[Arm | None] = (None,),
    ) -> np.ndarray:
        """See `Simulator`."""
        run = begin(machine, len(log.commands), session_seed, int(log.command_log_time_ns[0]))
        return replay(run, log.commands, machine, changes, starts, horizon, seed, PERIOD_S, instead)
