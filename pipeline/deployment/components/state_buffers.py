"""The buffers of x̃ on the machine (paper, appendix: the policy input of `autonomous_server`)."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.dynamics import Dynamics
from pipeline.dynamics.model.dynamics_model import ModelSpecification, Target


class Observer:
    """Estimates what a model's history holds beside the measured window, such as the states of effects."""

    def __init__(self, dynamics: Dynamics, parameters: Any) -> None:
        """Compiles its functions, so that nothing is compiled while the machine moves."""
        self._begin = jax.jit(lambda q: dynamics.at_rest(parameters, q))
        self._observe = jax.jit(lambda *measured: dynamics.observe(parameters, *measured))
        zero = np.zeros(dynamics.specification.n_joint)
        self.observe(self.begin(zero), zero, zero, zero)

    def begin(self, q: np.ndarray) -> Any:
        """History of a machine at rest in `q` (n_joint,)."""
        return self._begin(jnp.asarray(q, jnp.float32))

    def observe(self, history: Any, q: np.ndarray, velocity: np.ndarray, command: np.ndarray) -> Any:
        """History after one measured tick; arguments as of `Dynamics.observe`."""
        return self._observe(history, *(jnp.asarray(row, jnp.float32) for row in (q, velocity, command)))


class StateBuffers:
    """Rolling windows of motion and commands, one row per tick of the server.

    They start as those of a machine at rest without commands, as episodes in learning do.

    Attributes:
        history: The model's history of the same rows; None without an observer.
    """

    def __init__(self, specification: ModelSpecification, observer: Observer | None = None) -> None:
        self._target = specification.target
        rows = (specification.lags + 1, specification.n_joint)
        self.motion = np.zeros(rows, np.float32)
        self.commands = np.zeros(rows, np.float32)
        self.history: Any = None
        self._observer = observer
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
        # What is no number stays in the window for a while, but would stay in the states of effects for ever.
        if self._observer is not None and np.isfinite([position, velocity, command]).all():
            before = self._observer.begin(position) if self.history is None else self.history
            self.history = self._observer.observe(before, position, velocity, command)
