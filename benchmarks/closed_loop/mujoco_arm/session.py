"""Recorded sessions of arms, and stretches of them that happen again."""

from collections.abc import Sequence
from copy import copy

import mujoco
import numpy as np

from benchmarks.closed_loop.kinematic.encoder import read_encoders
from benchmarks.closed_loop.kinematic.operator import Driver
from benchmarks.closed_loop.kinematic.session import (
    COMMAND_LOG_DELAY_S,
    EXTRA_TIME_SHAPE,
    READING_LOG_DELAY_S,
    absolute_ns,
    stamps_s,
)
from benchmarks.closed_loop.mujoco_arm.arm import N_SUBSTEP, RATE_HZ, STEP_S, Arm
from benchmarks.closed_loop.mujoco_arm.hydraulics import drive, rods, vary
from benchmarks.closed_loop.mujoco_arm.quantities import N_SHARED, resting_state
from benchmarks.closed_loop.stretches import at_time
from pipeline.plant.recording.session import NANOSECONDS, SessionLog
from pipeline.plant.records import pack

START_SHARE = (0.3, 0.7)  # of each joint's range in which a session begins
PERIOD_S = 1.0 / RATE_HZ
N_STEP = round(PERIOD_S / STEP_S)
PHYSICS = mujoco.mjtState.mjSTATE_INTEGRATION
DIVERGED = mujoco.mjtWarning.mjWARN_BADQACC


class UnstableArmError(ArithmeticError):
    """The simulation of an arm diverged: MuJoCo would go on from its initial state as if nothing had happened."""


class Run:
    """An arm that is driven, period by period.

    Attributes:
        commands: (T, n) so far.
        path: (T N_STEP + 1, n) true positions at multiples of `STEP_S`, rad or m.
    """

    def __init__(self, arm: Arm, n_period: int, seed: int, start: np.ndarray, clock_s: float = 0.0) -> None:
        """At rest at `start`, (n,), for so many periods; the seed is of all chances from there on."""
        n = arm.model.nv
        random = np.random.default_rng(seed)
        self._state = pack(resting_state(arm.quantities, random.standard_normal(N_SHARED + n)))
        self._clock_s = clock_s
        self._arrival_s = np.zeros((n_period, n))
        self._chances(random, n_period, n)
        self.commands, self.path = np.zeros((n_period, n)), np.zeros((n_period * N_STEP + 1, n))
        self.path[0] = start
        self._change(arm)
        self._data.qpos[:] = start
        mujoco.mj_forward(self._model, self._data)
        self._hold_still()

    def _chances(self, random: np.random.Generator, n_period: int, n: int) -> None:
        self._jitter = random.uniform(-1.0, 1.0, (n_period, n))
        self._draw = random.standard_normal((n_period, N_SHARED + n))
        self._even = random.random((n_period, n))
        self._extra = random.gamma(EXTRA_TIME_SHAPE, 1.0 / EXTRA_TIME_SHAPE, (n_period, n))

    def _hold_still(self) -> None:
        """Chambers that carry the arm where it rests."""
        area = self._quantities[0].cylinder.area_m2
        force = self._data.qfrc_bias / rods(self._arm.transmission, self.path[0])[1]
        self._state[0].pressure_Pa += 0.5 * np.stack([-force, force], axis=1) / area[:, None]

    def _change(self, arm: Arm) -> None:
        self._arm, self._quantities = arm, pack(arm.quantities)
        before = getattr(self, "_data", None)
        self._model, self._data = arm.model, mujoco.MjData(arm.model)
        if before is not None:
            _copy(self._model, before, self._data)

    def advance(self, period: int, command: np.ndarray, arm: Arm) -> None:
        """Run one control period with a command, (n,) in [-1, 1]."""
        if arm is not self._arm:
            self._change(arm)
        self.commands[period] = command
        valve, begin_s = arm.quantities.valve, period * PERIOD_S
        self._arrival_s[period] = (
            begin_s + valve.dead_time_s + valve.dead_time_jitter_s * self._jitter[period]
        )
        vary(self._quantities, self._state, self._draw[period], self._even[period], PERIOD_S)
        model, data = self._model, self._data
        for step in range(N_STEP):
            time_s = begin_s + step * STEP_S
            drive(
                self._quantities,
                self._state,
                self.commands,
                self._arrival_s,
                self._extra[period],
                period,
                time_s,
                self._clock_s + time_s,
                arm.transmission,
                data.qpos,
                data.qvel,
                STEP_S / N_SUBSTEP,
                N_SUBSTEP,
                data.qfrc_applied,
            )
            mujoco.mj_step(model, data)
            self.path[period * N_STEP + step + 1] = data.qpos
        if data.warning[DIVERGED].number:
            raise UnstableArmError(f"the arm diverged {begin_s:.0f} s after its start")

    def twin(self, period: int, horizon: int, seed: int) -> "Run":
        """The same state at the begin of a period, for `horizon` periods more with other chances."""
        again = copy(self)
        again._state, again._data = self._state.copy(), mujoco.MjData(self._model)
        _copy(self._model, self._data, again._data)
        n_period, n = period + horizon, self._model.nv
        again._chances(np.random.default_rng(seed), n_period, n)
        again.commands, again._arrival_s = (
            np.concatenate([of[:period], np.zeros((horizon, n))]) for of in (self.commands, self._arrival_s)
        )
        again.path = np.zeros((n_period * N_STEP + 1, n))
        again.path[: period * N_STEP + 1] = self.path[: period * N_STEP + 1]
        return again

    def positions(self, first: int, last: int) -> np.ndarray:
        """(last - first + 1, n) true positions at the begins of periods `first` to `last`, rad or m."""
        return self.path[first * N_STEP : last * N_STEP + 1 : N_STEP]


def _copy(model: mujoco.MjModel, source: mujoco.MjData, target: mujoco.MjData) -> None:
    state = np.zeros(mujoco.mj_stateSize(model, PHYSICS))
    mujoco.mj_getState(model, source, state, PHYSICS)
    mujoco.mj_setState(model, target, state, PHYSICS)


def begin(arm: Arm, n_period: int, seed: int, start_time_ns: int) -> Run:
    """The session of that seed, at its start."""
    motion_seed, start_seed = np.random.SeedSequence(seed).generate_state(2).tolist()
    lower, upper = arm.specification.lower, arm.specification.upper
    share = np.random.default_rng(start_seed).uniform(*START_SHARE, lower.size)
    return Run(arm, n_period, motion_seed, lower + share * (upper - lower), start_time_ns // NANOSECONDS)


def record_session(
    arm: Arm,
    at_sticks: Driver,
    minutes: float,
    seed: int,
    start_time_ns: int,
    changes: Sequence[tuple[float, Arm]] = (),
) -> SessionLog:
    """Let somebody drive an arm; see `Simulator.record`."""
    n_period = round(minutes * 60.0 / PERIOD_S)
    run = begin(arm, n_period, seed, start_time_ns)
    publication, noise = (
        np.random.default_rng(stream) for stream in np.random.SeedSequence([seed, 1]).spawn(2)
    )
    stamp_s = stamps_s(publication, arm.quantities.encoder, n_period * PERIOD_S)
    age = publication.uniform(-1.0, 1.0, stamp_s.size)
    noise_draw = noise.standard_normal((stamp_s.size, arm.model.nv))
    readings, n_read = np.zeros((stamp_s.size, arm.model.nv)), 0
    measured = run.path[0]
    for period in range(n_period):
        present = at_time(arm, changes, period * PERIOD_S)
        run.advance(period, at_sticks.command(measured), present)
        until_s = (period + 1) * PERIOD_S
        encoder = pack(present.quantities)[0].encoder
        n_read = read_encoders(encoder, run.path, STEP_S, stamp_s, age, noise_draw, n_read, until_s, readings)
        measured = readings[n_read - 1] if n_read else measured
    begins_s = PERIOD_S * np.arange(n_period)
    return SessionLog(
        joint_names=arm.specification.joint_names,
        joint_state_header_stamp_ns=absolute_ns(stamp_s[:n_read], start_time_ns),
        joint_state_log_time_ns=absolute_ns(
            stamp_s[:n_read] + publication.uniform(*READING_LOG_DELAY_S, stamp_s.size)[:n_read], start_time_ns
        ),
        positions=readings[:n_read],
        command_log_time_ns=absolute_ns(
            begins_s + publication.uniform(*COMMAND_LOG_DELAY_S, n_period), start_time_ns
        ),
        commands=run.commands,
        true_positions=run.path[N_STEP::N_STEP].copy(),
    )
