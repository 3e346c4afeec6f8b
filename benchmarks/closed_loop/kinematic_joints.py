"""The kinematic machine as a simulator of the benchmark."""

from collections.abc import Sequence
from zlib import crc32

import numpy as np

from benchmarks.closed_loop import simulator
from benchmarks.closed_loop.kinematic import effects
from benchmarks.closed_loop.kinematic.effects import Effect
from benchmarks.closed_loop.kinematic.machine import Machine
from benchmarks.closed_loop.kinematic.session import begin, record_session
from benchmarks.closed_loop.machines import Variant
from benchmarks.closed_loop.stretches import replay
from benchmarks.machine_draws.kinematic import draw_kinematic
from pipeline.configuration.load import load_machine
from pipeline.plant.recording.session import SessionLog


class KinematicJoints(simulator.Simulator):
    """Joints of first order without forces; see `benchmarks.closed_loop.kinematic`."""

    name = "kinematic"
    variant_name = "kinematic_variant"
    entropy = (crc32(name.encode()),)
    outside = effects.OUTSIDE
    largest_size = effects.LARGEST_SIZE

    def drawn_machine(self, seed: int) -> Machine:
        """See `Simulator`."""
        return draw_kinematic(load_machine(simulator.MACHINE), seed)

    def draw_effect(self, kind: str, seed: int, variant: Variant, size: float) -> Effect:
        """See `Simulator`."""
        return effects.draw(kind, seed, variant, size)

    def record(
        self,
        machine: Machine,
        changes: Sequence[tuple[float, Machine]],
        style_seed: int,
        minutes: float,
        seed: int,
        start_time_ns: int,
    ) -> SessionLog:
        """See `Simulator`."""
        specification = self.specification(machine)
        return record_session(specification, machine, style_seed, minutes, seed, start_time_ns, changes)

    def replay(
        self,
        machine: Machine,
        log: SessionLog,
        session_seed: int,
        starts: Sequence[int],
        horizon: int,
        seed: int,
        changes: Sequence[tuple[float, Machine]] = (),
        instead: Sequence[Machine | None] = (None,),
    ) -> np.ndarray:
        """See `Simulator`."""
        specification = self.specification(machine)
        run = begin(specification, machine, log, session_seed)
        return replay(run, log.commands, machine, changes, starts, horizon, seed, specification.dt_s, instead)
