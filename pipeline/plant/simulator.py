"""The simulated machine: the compiled loop over substeps and the object that drives it.

The plant represents the real machine wherever this project uses measured data or Sim2Real. It shares no
form with the learned models: from discrete commands it integrates pilot stage, spools, pump, chambers,
rigid-body load, friction, stops and oil temperature, and publishes encoder readings.
"""

import copy
from dataclasses import dataclass

import numpy as np

from pipeline.errors import InputError
from pipeline.plant.compiled import compiled
from pipeline.plant.drawn import Rows
from pipeline.plant.parameters import NEGATIVE, POSITIVE, Linkage, Parameters
from pipeline.plant.physics.contact import find_contact
from pipeline.plant.physics.friction import apply_impulses
from pipeline.plant.physics.hydraulics import advance_pressures
from pipeline.plant.physics.load import dynamics, inverse_mass
from pipeline.plant.physics.oil import dynamic_viscosity, warmed
from pipeline.plant.physics.sensor import EncoderChannel, JointStates
from pipeline.plant.physics.valve import advance_pilots, advance_spools, read_command
from pipeline.plant.records import pack
from pipeline.plant.scratch import Scratch, allocate
from pipeline.plant.state import FRICTION, LATE, N_SWITCH, OTHERS, PISTON, STOP, State, resting_state, viewed


@compiled
def _interpolate(linkage: Linkage, joint: int, angle: float) -> tuple[float, float]:
    """Moment arm and cylinder travel at an angle, m; the nearest table entry beyond the stops."""
    n = linkage.moment_arm_m.shape[1]
    span = linkage.upper_rad[joint] - linkage.lower_rad[joint]
    place = (angle - linkage.lower_rad[joint]) / span * (n - 1)
    index = min(max(int(place), 0), n - 2)
    share = min(max(place - index, 0.0), 1.0)
    arm = linkage.moment_arm_m[joint, index]
    arm += share * (linkage.moment_arm_m[joint, index + 1] - arm)
    travel = linkage.travel_m[joint, index]
    travel += share * (linkage.travel_m[joint, index + 1] - travel)
    return arm, travel


@compiled
def _accelerate(
    parameters: Parameters, state: State, scratch: Scratch, viscosity_ratio: float, dt: float
) -> None:
    """Velocities after one substep of chamber pressures, viscous friction, gravity and inertia."""
    cylinder, n = parameters.cylinder, state.spool.size
    for j in range(n):
        arm, travel = _interpolate(parameters.linkage, j, state.angle_rad[j])
        force = cylinder.area_m2[j, POSITIVE] * state.chamber_Pa[j, POSITIVE]
        force -= cylinder.area_m2[j, NEGATIVE] * state.chamber_Pa[j, NEGATIVE]
        viscous = parameters.friction.viscous_N_s_m[j] * viscosity_ratio * arm * state.velocity_rad_s[j]
        scratch.moment_arm[j], scratch.travel[j] = arm, travel
        scratch.old_velocity[j] = state.velocity_rad_s[j]
        scratch.drive[j], scratch.drag[j] = arm * force, arm * viscous
        scratch.free[j] = arm * (force - viscous) - scratch.bias[j]
    for j in range(n):
        for i in range(n):
            state.velocity_rad_s[j] += dt * scratch.inverse_mass[j, i] * scratch.free[i]


@compiled
def _move(linkage: Linkage, state: State, scratch: Scratch, dt: float) -> None:
    """Angles after one substep at the new velocities; the link follows the drive within the pin clearance.

    Work is accounted with the mean of old and new velocity, with which impulses change the kinetic energy
    exactly by their work.
    """
    for j in range(state.spool.size):
        velocity = state.velocity_rad_s[j]
        mean = 0.5 * (velocity + scratch.old_velocity[j])
        state.energy_J[PISTON] += scratch.drive[j] * mean * dt
        state.energy_J[FRICTION] += (scratch.drag[j] * dt - scratch.friction_impulse[j]) * mean
        pushed = scratch.contact_impulse[0] * scratch.contact_arm[j]
        state.energy_J[STOP] -= (scratch.stop_impulse[j] + pushed) * mean
        scratch.piston_speed[j] = scratch.moment_arm[j] * velocity
        state.angle_rad[j] += velocity * dt
        half_play = 0.5 * linkage.play_rad[j]
        low, high = state.angle_rad[j] - half_play, state.angle_rad[j] + half_play
        state.link_angle_rad[j] = min(max(state.link_angle_rad[j], low), high)


@compiled
def _switch(
    state: State, switch: int, interval_s: float, duration_s: float, period_s: float, draw: float
) -> None:
    """One period of a process that is on and off for exponentially distributed times; `draw` is uniform in [0, 1)."""
    mean_s = duration_s if state.switches[switch] else interval_s
    if draw < 1.0 - np.exp(-period_s / mean_s):
        state.switches[switch] = 1 - state.switches[switch]


@compiled
def _advance(
    parameter_record: np.ndarray,
    state_record: np.ndarray,
    scratch_record: np.ndarray,
    commands: np.ndarray,
    jitter_s: np.ndarray,
    phase: int,
    disturbance_draw: np.ndarray,
    silt_draw: np.ndarray,
    switch_draw: np.ndarray,
    trace: np.ndarray,
) -> None:
    """Run all control periods of `commands` and write the true angles into `trace`.

    Args:
        parameter_record: the machine, one record.
        state_record: changed in place, one record.
        scratch_record: work arrays, one record.
        commands: (T, n) int8.
        jitter_s: (T,) how far into its period each command reaches the controller.
        phase: of the controller's cycle, substeps.
        disturbance_draw: (T, n + 2) standard normal, drives pilot noise, engine ripple and relief wander.
        silt_draw: (T, n) standard normal, strength of silt locks that begin in a period.
        switch_draw: (T, N_SWITCH) uniform, when commands are late and when other functions run.
        trace: written, (T * substeps / trace_stride, n), rad.
    """
    parameters, state, scratch = parameter_record[0], state_record[0], scratch_record[0]
    numerics, pilot, oil = parameters.numerics, parameters.pilot, parameters.oil
    dt = numerics.substep_s
    n = state.spool.size
    n_substep = round(numerics.control_period_s / dt)
    stride = numerics.trace_stride
    command = state.controller_command.copy()
    row = 0
    for period in range(commands.shape[0]):
        # Ornstein-Uhlenbeck processes of unit variance, exact at the control rate
        for i in range(n + 2):
            correlation = pilot.noise_correlation_s if i < n else parameters.supply.ripple_correlation_s
            kept = np.exp(-numerics.control_period_s / correlation)
            state.disturbance[i] = (
                kept * state.disturbance[i] + np.sqrt(1.0 - kept**2) * disturbance_draw[period, i]
            )
        period_s, supply = numerics.control_period_s, parameters.supply
        _switch(state, LATE, pilot.late_interval_s, pilot.late_s, period_s, switch_draw[period, LATE])
        _switch(
            state, OTHERS, supply.others_interval_s, supply.others_s, period_s, switch_draw[period, OTHERS]
        )
        viscosity = dynamic_viscosity(oil, state.oil_C[0])
        ratio = viscosity / oil.reference_viscosity_Pa_s
        arrival = min(round(jitter_s[period] / dt), n_substep - 1)
        for substep in range(n_substep):
            if substep == arrival and not state.switches[LATE]:
                command[:] = commands[period]
            read_command(pilot, state, command, phase, dt)
            advance_pilots(pilot, state, ratio, dt)
            advance_spools(pilot, parameters.spool, state, silt_draw[period], dt)

            dynamics(parameters.links, state.angle_rad, state.velocity_rad_s, scratch)
            inverse_mass(scratch.mass, scratch.inverse_mass)
            find_contact(parameters.contact, state, scratch)
            _accelerate(parameters, state, scratch, ratio, dt)
            apply_impulses(parameters.friction, parameters.linkage, state, scratch, dt)
            _move(parameters.linkage, state, scratch, dt)
            advance_pressures(parameters, state, scratch, viscosity, dt)
            if (substep + 1) % stride == 0:
                trace[row] = state.link_angle_rad
                row += 1
        state.oil_C[0] = warmed(oil, state.oil_C[0], state.heat_J[0], numerics.control_period_s)
        state.heat_J[0] = 0.0


@dataclass(frozen=True)
class PlantSample:
    """What one call of the plant produced in T control periods. Times are seconds since the start."""

    end_s: np.ndarray  # (T,) ends of the control periods
    angle_rad: np.ndarray  # (T, n_joint) true joint angles at those ends
    command_log_s: np.ndarray  # (T,) when each command was logged
    joint_states: JointStates


class Plant:
    """A simulated machine and its state.

    The same parameters, seed, start and commands give the same samples, independent of the division of commands
    over calls.

    Attributes:
        state: the present state; views, not copies.
    """

    def __init__(self, parameters: Parameters, seed: int, start_configuration: np.ndarray) -> None:
        """A machine at rest in `start_configuration`, (n_joint,), rad.

        Raises:
            InputError: the start lies outside the stops, or a dead time exceeds the plant's memory.
        """
        self.parameters = parameters
        self._parameter_record = np.asarray(pack(parameters))
        self._state_record = np.asarray(pack(resting_state(parameters, start_configuration)))
        self.state = viewed(self._state_record)
        self._scratch_record = np.asarray(pack(allocate(self.n_joint)))
        n_ring = self.state.command_ring.shape[0]
        if np.max(parameters.pilot.dead_time_s) >= n_ring * parameters.numerics.substep_s:
            raise InputError(
                f"dead times {parameters.pilot.dead_time_s.tolist()} s exceed the plant's memory"
            )
        self._begin(seed)

    def _begin(self, seed: int) -> None:
        """Set the clock to zero and draw chances; the slow processes begin in their stationary distribution."""
        self._n_period = 0
        self._n_row = 0
        streams = np.random.SeedSequence(seed).spawn(6)
        disturbance, silt, arrival, phase, _, switches = (np.random.default_rng(s) for s in streams)
        self._disturbance = Rows(disturbance.standard_normal, self.n_joint + 2)
        self._silt = Rows(silt.standard_normal, self.n_joint)
        self._arrival, self._switches = Rows(arrival.random, 1), Rows(switches.random, N_SWITCH)
        self._encoders = EncoderChannel(self.n_joint, streams[4])
        cycle_s, substep_s = self.parameters.pilot.controller_cycle_s, self.parameters.numerics.substep_s
        self._phase = int(phase.integers(max(round(cycle_s / substep_s), 1)))
        self.state.disturbance[:] = phase.standard_normal(self.n_joint + 2)

    @property
    def n_joint(self) -> int:
        """Number of joints."""
        return self.state.spool.size

    @property
    def time_s(self) -> float:
        """Time since the start, s."""
        return self._n_period * self.parameters.numerics.control_period_s

    def twin(self, seed: int) -> "Plant":
        """Another plant in the same state at time zero, whose chances are drawn by another seed."""
        twin = copy.copy(self)
        twin._state_record = self._state_record.copy()
        twin.state = viewed(twin._state_record)
        twin._scratch_record = self._scratch_record.copy()
        twin._begin(seed)
        return twin

    def change(self, parameters: Parameters) -> None:
        """Replace the parameters; the state is kept."""
        self.parameters = parameters
        self._parameter_record = np.asarray(pack(parameters))

    def stop_engine(self, duration_s: float) -> None:
        """Let the machine stand with its engine off; the clock does not count that, and no command may be in force.

        Pressures fall, the oil cools towards the ambience, and spools rest. The arm's sag in that time is left out.
        """
        oil, state = self.parameters.oil, self.state
        kept = np.exp(-duration_s * oil.heat_loss_W_K / oil.heat_capacity_J_K)
        state.oil_C[0] = oil.ambient_C + kept * (state.oil_C[0] - oil.ambient_C)
        state.supply_Pa[0] = 2.0 * self.parameters.supply.return_pressure_Pa
        state.coil_warmth[:] = 0.0
        state.spool_rest_s[:] += duration_s

    def step(self, command: np.ndarray) -> PlantSample:
        """One control period under `command`, (n_joint,), values -1, 0, 1."""
        return self.run(np.asarray(command)[None])

    def run(self, commands: np.ndarray) -> PlantSample:
        """As many control periods as `commands`, (T, n_joint), values -1, 0, 1, has rows.

        Raises:
            InputError: wrong shape or values.
        """
        commands = np.asarray(commands)
        is_known = (commands == 0) | (commands == 1) | (commands == -1)  # np.isin takes ten times as long
        if commands.ndim != 2 or commands.shape[1] != self.n_joint or not is_known.all():
            raise InputError(
                f"commands of shape {commands.shape} and values {np.unique(commands)[:5].tolist()}: the "
                f"plant takes rows of {self.n_joint} values -1, 0 or 1"
            )
        numerics, sensor = self.parameters.numerics, self.parameters.sensor
        n_period = commands.shape[0]
        n_substep = round(numerics.control_period_s / numerics.substep_s)
        n_row = n_period * (n_substep // numerics.trace_stride)
        jitter_s = 2.0 * sensor.command_jitter_s * self._arrival.take(n_period)[:, 0]
        trace = np.empty((n_row, self.n_joint))
        _advance(
            self._parameter_record,
            self._state_record,
            self._scratch_record,
            np.ascontiguousarray(commands, dtype=np.int8),
            jitter_s,
            self._phase,
            self._disturbance.take(n_period),
            self._silt.take(n_period),
            self._switches.take(n_period),
            trace,
        )
        step_s = numerics.substep_s * numerics.trace_stride
        # times from integer counts, so that they do not depend on the division of calls
        trace_s = step_s * (self._n_row + 1.0 + np.arange(n_row))
        period_s = numerics.control_period_s
        begins = period_s * (self._n_period + np.arange(n_period))
        ends = period_s * (self._n_period + 1.0 + np.arange(n_period))
        self._n_period += n_period
        self._n_row += n_row
        return PlantSample(
            end_s=ends,
            angle_rad=trace[
                n_substep // numerics.trace_stride - 1 :: n_substep // numerics.trace_stride
            ].copy(),
            command_log_s=begins + jitter_s,
            joint_states=self._encoders.publish(sensor, trace_s, trace),
        )
