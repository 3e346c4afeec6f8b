"""`joystick`: somebody scripted at the sticks, where no joystick is at hand; a joystick's own node takes its place."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from pipeline.deployment.component import Component, Output, Publication, nanoseconds
from pipeline.deployment.messages import JointState, Joystick, Message, Topic
from pipeline.deployment.settings import TeleoperationConfig
from pipeline.machine.specification import MachineSpecification


class Teleoperator(Protocol):
    """Whoever looks at the machine and decides how it is to move."""

    def command(self, measured: np.ndarray) -> np.ndarray:
        """The command for this control period, (n_joint,), of the newest joint angles, (n_joint,), rad (m)."""


class ScriptedJoystick(Component):
    """Turns the commands of a teleoperator into deflections of the sticks that `teleoperation_server` reads as them."""

    name = "joystick"
    subscriptions = (Topic.joint_states,)

    def __init__(
        self, machine: MachineSpecification, config: TeleoperationConfig, teleoperator: Teleoperator
    ) -> None:
        """A joystick whose sticks are moved once per control period, by the map that its interpreter has, too."""
        self.period_ns = nanoseconds(machine.dt_s)
        self._axes, self._signs = config.sticks(machine)
        self._teleoperator = teleoperator
        self._measured: np.ndarray | None = None

    def on_message(self, topic: Topic, message: Message, now_ns: int) -> Sequence[Output]:
        """What the operator sees of the machine."""
        if isinstance(message, JointState):
            self._measured = message.position
        return ()

    def on_timer(self, now_ns: int) -> Sequence[Output]:
        """Move the sticks; they are let be until there is something to see."""
        if self._measured is None:
            return ()
        axes = np.zeros(self._axes.max() + 1)
        axes[self._axes] = self._signs * self._teleoperator.command(self._measured)
        return (Publication(Topic.joystick, Joystick(now_ns, axes)),)
