"""Plays a plan as an operator would: brings the arm to its places by sight, and holds commands by the clock."""

import numpy as np

from pipeline.discrepancy.experiment.plan import Plan, Step
from pipeline.machine.specification import MachineSpecification

ATTEMPTS = 3  # to come near a goal; the commands of a manoeuvre do not depend on how near


class PlanPlayer:
    """A teleoperator (see `ScriptedJoystick`) who follows a plan."""

    def __init__(self, machine: MachineSpecification, plan: Plan) -> None:
        """A player before the first step."""
        self._dt_s = machine.dt_s
        self._names = machine.joint_names
        self._steps = list(plan.steps)
        self._speed = np.array([plan.speed[name] for name in self._names])
        self._tolerance = np.array([plan.tolerance[name] for name in self._names])
        self._n_rest = max(round(plan.rest_s / self._dt_s), 1)
        self._place = 0
        self._begin()

    def _begin(self) -> None:
        self._ticks = self._attempts = self._resting = 0
        self._left: np.ndarray | None = None  # ticks under command, from the first on
        self._way = np.zeros(len(self._names))

    @property
    def is_done(self) -> bool:
        """Whether the last step is over."""
        return self._place >= len(self._steps)

    @property
    def step(self) -> int:
        """Index of the present step."""
        return min(self._place, len(self._steps) - 1)

    def command(self, measured: np.ndarray) -> np.ndarray:
        """The command for this control period, (n_joint,), of the newest positions, (n_joint,), rad (m)."""
        while not self.is_done:
            step = self._steps[self._place]
            command = self._bring(step, measured) if step.goal else self._hold(step)
            if command is not None:
                return command
            self._place += 1
            self._begin()
        return np.zeros(len(self._names))

    def _hold(self, step: Step) -> np.ndarray | None:
        if self._ticks >= round(step.seconds / self._dt_s):
            return None
        self._ticks += 1
        return np.array([step.command.get(name, 0.0) for name in self._names])

    def _bring(self, step: Step, measured: np.ndarray) -> np.ndarray | None:
        """Towards the goal for as long as the usual speed takes, and again from rest where that missed it.

        Whatever dead time and lag a joint has, it moves on by as much at the end as it was late at the beginning.
        """
        goal = np.array([step.goal.get(name, q) for name, q in zip(self._names, measured, strict=True)])
        error = goal - measured
        if self._left is None:
            if self._attempts >= ATTEMPTS or (np.abs(error) <= self._tolerance).all():
                return None
            self._attempts += 1
            self._way = np.where(np.abs(error) > self._tolerance, np.sign(error), 0.0)
            self._left = np.round(np.abs(error) / self._speed / self._dt_s)
            self._ticks = 0
        self._left[error * self._way <= 0.0] = 0.0  # it is faster than usual, and there already
        command = np.where(self._ticks < self._left, self._way, 0.0)
        self._ticks += 1
        self._resting = 0 if command.any() else self._resting + 1
        if self._resting >= self._n_rest:
            self._left = None
        return command
