"""The simulated PLC of the real graph, which publishes its outputs to time stops."""

from collections.abc import Sequence

import numpy as np

from pipeline.deployment.component import Output, Publication
from pipeline.deployment.drivers.programmable_controller import ProgrammableController
from pipeline.deployment.messages import MachineOutputs, Topic


class ObservedPlc(ProgrammableController):
    """Publishes its outputs at every change."""

    def on_timer(self, now_ns: int) -> Sequence[Output]:
        """One cycle."""
        before = self.output
        outputs = super().on_timer(now_ns)
        if np.array_equal(before, self.output):
            return outputs
        return [*outputs, Publication(Topic.machine_outputs, MachineOutputs(now_ns, self.output.copy()))]
