"""The kinematic machine as a simulator of the benchmark."""

from collections.abc import Sequence
from zlib import crc32

import numpy as np

from benchmarks.closed_loop import simulator
from benchmarks.closed_loop.kinematic import effects
from benchmarks.closed_loop.kinematic.effects import Effect
from benchmarks.closed_loop.kinematic.machine import Machine, draw_machine
from benchmarks.closed_loop.kinematic.replay import replay
from benchmarks.closed_loop.kinematic.session import record_session
from benchmarks.closed_loop.machines import Variant
from benchmarks.machine_draws.kinematic import draw_kinematic
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.recording.session import SessionLog


class KinematicJoints(simulator.Simulator):
    """Joints of first order without forces; see `benchmarks.closed_loop.kinematic`."""

    name = "kinematic"
    variant_name = "kinematic_variant"
    entropy = (crc32(name.encode()),)
    outside = effects.OUTSIDE
    largest_size = effects.LARGEST_SIZE
    often_unseen = effects.OFTEN_UNSEEN

    def sound_machine(self, specification: MachineSpecification, number: int, seed: int) -> Machine:
        """See `Simulator`."""
        return draw_machine(specification, number, seed)

    def drawn_machine(self, specification: MachineSpecification, seed: int) -> Machine:
        """See `Simulator`."""
        return draw_kinematic(specification, seed)

    def draw_effect(self, kind: str, seed: int, variant: Variant, size: float) -> Effect:
        """See `Simulator`."""
        return effects.draw(kind, seed, variant, size)

    def record(
        self,
        specification: MachineSpecification,
        machine: Machine,
        changes: Sequence[tuple[float, Machine]],
        style_seed: int,
        minutes: float,
        seed: int,
        start_time_ns: int,
    ) -> SessionLog:
        """See `Simulator`."""
        return record_session(specification, machine, style_seed, minutes, seed, start_time_ns, changes)

    def replay(
        self,
        specification: MachineSpecification,
        machine: Machine,
        log: SessionLog,
        session_seed: int,
        starts: Sequence[int],
        horizon: int,
        seed: int,
    ) -> np.ndarray:
        """See `Simulator`."""
        return replay(specification, machine, log, starts, horizon, seed)
