"""The interface of a driven machine, and the learned model as a machine."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.deployment.component import nanoseconds
from pipeline.dynamics.model.dynamics import MeasuredHistory
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.reaching.task import Goal, ReachingTask


class Sample(NamedTuple):
    """One reading of all joints.

    Attributes:
        age_ns: time from sampling to the end of its period, ns.
        position: rad (m), (n_joint,).
        velocity: rad/s (m/s), (n_joint,); None if the driver must estimate it.
    """

    age_ns: int
    position: np.ndarray
    velocity: np.ndarray | None


class Machine(Protocol):
    """A machine in simulated or wall-clock time, advanced by the owner of the clock."""

    @property
    def period_ns(self) -> int:
        """Length of one period, ns."""

    def advance(self, command: np.ndarray) -> Sequence[Sample]:
        """Run one period under `command`, (n_joint,); return the readings that became due, oldest first."""

    def read(self) -> Sequence[Sample]:
        """The readings before the first period."""


class LearnedStep:
    """One tick of the learned model with its end stops, compiled once for all machines of a task."""

    def __init__(self, task: ReachingTask) -> None:
        self.task = task

        def step(history: MeasuredHistory, command: jax.Array) -> tuple[MeasuredHistory, jax.Array]:
            pose = task.arm.forward(history.q)
            state = task.begin_at(history.q, pose, Goal(history.q, pose))._replace(history=history)
            after = task.tick(state, command)[0].history  # the compiler removes the tick's other outputs
            return after, jnp.stack([after.q, after.motion[-1]])  # one array, as each transfer costs a call

        self._step = jax.jit(step)

    def __call__(self, history: MeasuredHistory, command: np.ndarray) -> tuple[MeasuredHistory, np.ndarray]:
        """History after one tick under `command`, its configuration and its newest motion, (2, n_joint), float64."""
        after, newest = self._step(history, command)
        return after, np.asarray(newest, np.float64)


class LearnedMachine:
    """The learned dynamics in place of physics (paper: the model inside `bobcat_e10_sim_driver`).

    Its velocity reading is the model's estimate; for a model of positions, their rate of change.
    """

    def __init__(self, step: LearnedStep, start: np.ndarray) -> None:
        """A machine at rest in `start`, (n_joint,), rad (m)."""
        self._step = step
        self._dynamics = step.task.dynamics
        self._history = self._dynamics.at_rest(step.task.parameters, jnp.asarray(start, jnp.float32))
        self._last = np.asarray(start, np.float64)

    @property
    def period_ns(self) -> int:
        """One step of the model."""
        return nanoseconds(self._dynamics.specification.dt_s)

    def read(self) -> Sequence[Sample]:
        """The start configuration, at rest."""
        return (Sample(0, self._last, np.zeros_like(self._last)),)

    def advance(self, command: np.ndarray) -> Sequence[Sample]:
        """One step of the model."""
        self._history, (position, velocity) = self._step(self._history, np.asarray(command, np.float32))
        if self._dynamics.specification.target is Target.dq:
            velocity = (position - self._last) / self._dynamics.specification.dt_s
        self._last = position
        return (Sample(0, position, velocity),)


class TracedMachine:
    """A machine that stores commands exactly as they acted, unlike a log."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self.commands: list[np.ndarray] = []

    @property
    def period_ns(self) -> int:
        """Length of one period, ns."""
        return self._machine.period_ns

    def read(self) -> Sequence[Sample]:
        """The readings before the first period."""
        return self._machine.read()

    def advance(self, command: np.ndarray) -> Sequence[Sample]:
        """Run one period."""
        self.commands.append(np.array(command, np.float64))
        return self._machine.advance(command)
