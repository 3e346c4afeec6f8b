"""`joystick`: a scripted operator at the sticks, in place of a joystick's node."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from pipeline.deployment.component import Component, Output, Publication, nanoseconds
from pipeline.deployment.messages import JointState, Joystick, Message, Topic
from pipeline.deployment.settings import TeleoperationConfig
from pipeline.machine.specification import MachineSpecification


class Teleoperator(Protocol):
    """An operator, who observes the machine and commands it."""

    def command(self, measured: np.ndarray) -> np.ndarray:
        """The command for this control period, (n_joint,), of the newest joint angles, (n_joint,), rad (m)."""


class ScriptedJoystick(Component):
    """Turns a teleoperator's commands into stick deflections, which `teleoperation_server` maps back."""

    name = "joystick"
    subscriptions = (Topic.joint_states,)

    def __init__(
        self, machine: MachineSpecification, config: TeleoperationConfig, teleoperator: Teleoperator
    ) -> None:
        """A joystick whose sticks move once per control period, with its interpreter's map."""
        self.period_ns = nanoseconds(machine.dt_s)
        self._axes, self._signs = config.sticks(machine)
        self._teleoperator = teleoperator
        self._measured: np.ndarray | None = None

    def on_message(self, topic: Topic, message: Message, now_ns: int) -> Sequence[Output]:
        """Store the joint state that the operator observes."""
        if isinstance(message, JointState):
            self._measured = message.position
        return ()

    def on_timer(self, now_ns: int) -> Sequence[Output]:
        """Move the sticks, once a joint state has arrived."""
        if self._measured is None:
            return ()
        axes = np.zeros(self._axes.max() + 1)
        axes[self._axes] = self._signs * self._teleoperator.command(self._measured)
        return (Publication(Topic.joystick, Joystick(now_ns, axes)),)
