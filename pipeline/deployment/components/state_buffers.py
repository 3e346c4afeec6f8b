"""The buffers of x̃ on the machine (paper, appendix: the policy input of `autonomous_server`)."""

import numpy as np

from pipeline.dynamics.model.dynamics_model import ModelSpecification, Target


class StateBuffers:
    """Rolling windows of motion and commands, one row per tick of the server.

    They start as those of a machine at rest without commands, as episodes in learning do.
    """

    def __init__(self, specification: ModelSpecification) -> None:
        self._target = specification.target
        rows = (specification.lags + 1, specification.n_joint)
        self.motion = np.zeros(rows, np.float32)
        self.commands = np.zeros(rows, np.float32)
        self._is_empty = True

    def push(self, position: np.ndarray, velocity: np.ndarray, command: np.ndarray) -> None:
        """Append a row: the newest joint state, and the command in force before it; each (n_joint,)."""
        newest = position if self._target is Target.dq else velocity
        if self._is_empty:
            self.motion[:] = position if self._target is Target.dq else 0.0
            self._is_empty = False
        self.motion[:-1] = self.motion[1:]
        self.motion[-1] = newest
        self.commands[:-1] = self.commands[1:]
        self.commands[-1] = command
