"""The pipeline's plant as a simulator of the benchmark."""

from collections.abc import Sequence

import numpy as np

from benchmarks.closed_loop import simulator
from benchmarks.closed_loop.machines import Variant
from benchmarks.closed_loop.stretches import replay
from benchmarks.machine_draws.hydraulic import draw_hydraulic
from pipeline.plant import effects
from pipeline.plant.effects import PlantEffect
from pipeline.plant.machines.simulated import simulated_machine
from pipeline.plant.parameters import Parameters
from pipeline.plant.recording.operator import draw_style
from pipeline.plant.recording.session import SessionLog, record_session, session_plant
from pipeline.plant.simulator import Plant

LARGEST_SIZE = {
    "gain": 1.7,  # three quarters of the metering area gone
    "delay": 2.0,  # 0.6 s
    "lag": 3.0,  # 1.2 s
    "flow_coupling": 1.2,  # single motions would slow down as well
    "load": 2.0,  # 180 kg at the tip of a machine of 1.1 t
    "thermal_drift": 1.2,  # lines that resist 24 times as much
    "supply_variation": 2.0,  # engine speed wanders by a third
    "leakage": 3.0,  # 0.1 rad/s
    "backlash": 2.5,  # 0.15 rad
    "stiction": 1.0,  # stronger locks never let go
    "end_cushion": 2.0,  # 0.8 rad of the range
    "sensor_bias": 2.5,  # 0.25 rad, or a quarter of the scale
    "timing": 2.0,  # 0.4 s
    "oscillation": 2.0,  # the softest hose, once more
    "pilot_crosstalk": 1.15,  # more opens a spool by itself
    "coil_fade": 1.6,  # 64 % of the pilot pressure
    "hose_kink": 4.0,
    "line_clogging": 4.0,
    "pilot_supply_sag": 1.1,  # all of the pilot pressure
}
"""Physical bound of each kind's size, with what the strongest draw comes to there."""


class HydraulicPlant(simulator.Simulator):
    """Pressures, masses, friction; see `pipeline.plant`."""

    name = "plant"
    variant_name = "variant"
    entropy = ()
    outside = ("pilot_crosstalk", "coil_fade", "hose_kink", "line_clogging", "pilot_supply_sag")
    largest_size = LARGEST_SIZE

    def drawn_machine(self, seed: int) -> Parameters:
        """See `Simulator`."""
        return draw_hydraulic(simulated_machine(simulator.MACHINE), seed)

    def draw_effect(self, kind: str, seed: int, variant: Variant, size: float) -> PlantEffect:
        """See `Simulator`."""
        return effects.draw(kind, seed, variant.parameters, size)

    def record(
        self,
        machine: Parameters,
        changes: Sequence[tuple[float, Parameters]],
        style_seed: int,
        minutes: float,
        seed: int,
        start_time_ns: int,
    ) -> SessionLog:
        """See `Simulator`."""
        return record_session(
            self.specification(machine),
            machine,
            draw_style(style_seed),
            minutes,
            seed,
            start_time_ns=start_time_ns,
            changes=changes,
        )

    def replay(
        self,
        machine: Parameters,
        log: SessionLog,
        session_seed: int,
        starts: Sequence[int],
        horizon: int,
        seed: int,
        changes: Sequence[tuple[float, Parameters]] = (),
        instead: Sequence[Parameters | None] = (None,),
    ) -> np.ndarray:
        """See `Simulator`."""
        plant = session_plant(self.specification(machine), machine, session_seed)
        run, period_s = _Run(plant, machine), machine.numerics.control_period_s
        return replay(run, log.commands, machine, changes, starts, horizon, seed, period_s, instead)


class _Run:
    """See `stretches.Run`."""

    def __init__(self, plant: Plant, machine: Parameters) -> None:
        self._plant, self._machine = plant, machine
        self._angles = [plant.state.link_angle_rad.copy()]

    def advance(self, period: int, command: np.ndarray, machine: Parameters) -> None:
        if machine is not self._machine:
            self._plant.change(machine)
            self._machine = machine
        self._plant.step(command)
        self._angles.append(self._plant.state.link_angle_rad.copy())

    def twin(self, period: int, horizon: int, seed: int) -> "_Run":
        return _Run(self._plant.twin(seed), self._machine)

    def positions(self, first: int, last: int) -> np.ndarray:
        return np.array(self._angles[first - last - 1 :])
