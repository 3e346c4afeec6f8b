"""`bobcat_e10_sim_driver`: a simulated machine in place of the real one (paper, appendix)."""

from collections.abc import Sequence

import numpy as np

from pipeline.deployment.component import Component, Condition, Output, Publication, nanoseconds
from pipeline.deployment.components.velocity_estimator import VelocityEstimator
from pipeline.deployment.drivers.machine import Machine, Sample
from pipeline.deployment.messages import JointState, Level, MachineCommand, Message, Topic
from pipeline.deployment.settings import DriverConfig


class SimulationDriver(Component):
    """Advances the machine by one period per tick under the newest command, and publishes its readings.

    Like the machine's controller it holds the last command, and zeroes it after a time without commands.
    The first tick publishes the machine's present readings.
    """

    name = "bobcat_e10_sim_driver"
    subscriptions = (Topic.joint_commands,)

    def __init__(
        self, machine: Machine, n_joint: int, config: DriverConfig, estimator: VelocityEstimator | None = None
    ) -> None:
        """A driver; `estimator` gives the velocities if the machine does not measure them."""
        self.period_ns = machine.period_ns
        self._machine = machine
        self._estimator = estimator
        self._timeout_ns = nanoseconds(config.command_timeout_s)
        self._command = self._zero = np.zeros(n_joint, np.float32)
        self._received_ns = 0
        self._has_started = False
        self._velocity = np.zeros(n_joint)

    def on_message(self, topic: Topic, message: Message, now_ns: int) -> Sequence[Output]:
        """The newest command acts from the next tick on."""
        if isinstance(message, MachineCommand):
            self._command, self._received_ns = message.values, now_ns
        return ()

    def on_timer(self, now_ns: int) -> Sequence[Output]:
        """One period of the machine."""
        if not self._has_started:
            self._has_started = True
            return self._publish(self._machine.read(), now_ns)
        if now_ns - self._received_ns > self._timeout_ns:
            self._command = self._zero
        return self._publish(self._machine.advance(self._command), now_ns)

    def condition(self, now_ns: int) -> Condition:
        """The command in force."""
        is_timed_out = now_ns - self._received_ns > self._timeout_ns
        text = "no commands: outputs are zero" if is_timed_out else "commands come"
        return Condition(Level.ok, text, {"command": str(np.asarray(self._command).tolist())})

    def _publish(self, samples: Sequence[Sample], now_ns: int) -> Sequence[Output]:
        return [
            Publication(
                Topic.joint_states,
                JointState(now_ns - sample.age_ns, sample.position, self._velocity_of(sample, now_ns)),
            )
            for sample in samples
        ]

    def _velocity_of(self, sample: Sample, now_ns: int) -> np.ndarray:
        if sample.velocity is not None:
            return sample.velocity
        if self._estimator is None:
            return self._velocity
        return self._estimator.update(now_ns - sample.age_ns, sample.position)
