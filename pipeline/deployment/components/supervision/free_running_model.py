"""The model beside the machine: displacements that it expects of commands alone."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.dynamics import Dynamics
from pipeline.dynamics.model.specification import Target
from pipeline.dynamics.model.stops import Stops
from pipeline.effects.augmented_model import AugmentedHistory
from pipeline.machine.specification import MachineSpecification


class FreeRunningModel:
    """Steps in which positions are measured and velocities are the model's own.

    With measured velocities in its window, a model expects a joint that has become slow to stay slow.
    """

    def __init__(self, dynamics: Dynamics, parameters: Any, machine: MachineSpecification) -> None:
        """The model of a machine, compiled; joint limits act as end stops."""
        self.specification = dynamics.specification
        self.settling_steps = (
            dynamics.specification.lags + 1
        )  # a window that began at rest says nothing of motion
        stops = Stops(np.asarray(machine.lower, np.float32), np.asarray(machine.upper, np.float32))

        def step(history: Any, row: tuple[jax.Array, jax.Array]) -> tuple[Any, jax.Array]:
            q, command = row
            after = dynamics.step(
                parameters, moved_to(history, q, dynamics.specification.target), command, stops
            )
            return after, after.q - q

        self._begin: Callable[[jax.Array], Any] = jax.jit(dynamics.initial_history)
        self._step = jax.jit(step)
        self._run = jax.jit(lambda history, q, a: jax.lax.scan(step, history, (q, a))[1])

    def begin(self, q: np.ndarray) -> Any:
        """The history of a machine at rest in `q` (n_joint,), rad (m)."""
        return self._begin(jnp.asarray(q, jnp.float32))

    def step(self, history: Any, q: np.ndarray, command: np.ndarray) -> tuple[Any, np.ndarray]:
        """The next history, and the displacement from measured `q` under `command`; each (n_joint,), rad (m)."""
        after, displacement = self._step(
            history, (np.asarray(q, np.float32), np.asarray(command, np.float32))
        )
        return after, np.asarray(displacement, np.float64)

    def displacements(self, q: np.ndarray, a: np.ndarray) -> np.ndarray:
        """As `step` over rows that begin at rest: q and a (T, n_joint); (T - 1, n_joint)."""
        rows = np.asarray(q, np.float32), np.asarray(a, np.float32)
        return np.asarray(self._run(self.begin(q[0]), *rows), np.float64)[:-1]


def moved_to(history: Any, q: jax.Array, target: Target) -> Any:
    """The same motion elsewhere: positions of the window are shifted to end at `q` (n_joint,)."""
    shift = q - history.q
    motion = history.motion + shift if target is Target.dq else history.motion
    if isinstance(history, AugmentedHistory):
        nominal = moved_to(history.nominal, history.nominal.q + shift, target)
        return history._replace(motion=motion, q=q, nominal=nominal)
    return history._replace(motion=motion, q=q)
