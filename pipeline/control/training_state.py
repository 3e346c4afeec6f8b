"""All of a training's state between two points of the curve, so that a resumed one is the same to the last bit.

Brax's PPO restores networks and statistics alone, and begins Adam's moments, the running episodes and the random stream
afresh. Its loop on the host is a plain one, though: it splits a key and hands all state to one compiled epoch. What
stands here puts itself around that epoch. A resumed training runs the loop from the start with the same seed; epochs
that are done are passed over, and the last of them gives the state that was saved.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from pipeline.control.checkpoint import restored_like

EPOCH = "training_epoch"  # what Brax calls the function that it compiles

Epoch = Callable[[Any, Any, Any], tuple[Any, Any, Any]]


class Epochs:
    """Brax's epochs, from the first one that is not done."""

    def __init__(self, n_done: int, state: list[np.ndarray] | None) -> None:
        """Pass over `n_done` epochs, the last of which gives `state` (arrays as of `saved`)."""
        self._n_left, self._restored = n_done, state
        self._latest: Any = None

    def saved(self) -> list[np.ndarray] | None:
        """The state after the newest epoch: its arrays in their order; None before the first."""
        if self._latest is None:
            return None
        return [np.asarray(leaf) for leaf in jax.tree.leaves(self._latest)]

    def around(self, epoch: Epoch) -> Epoch:
        """Brax's compiled epoch, or what takes its place while it is done."""

        def run(training_state: Any, environment_state: Any, key: Any) -> tuple[Any, Any, Any]:
            if self._n_left == 0:
                result = epoch(training_state, environment_state, key)
                self._latest = result[:2]
                return result
            self._n_left -= 1
            if self._n_left == 0:
                self._latest = restored_like((training_state, environment_state), self._restored or [])
                training_state, environment_state = self._latest
            return training_state, environment_state, {}

        return run

    @contextmanager
    def taking_over(self) -> Iterator[None]:
        """Within the block Brax's PPO runs these epochs."""
        n_found, compiling = 0, jax.pmap
        if jax.__version_info__ >= (0, 10):  # which has none
            jax.device_put_replicated = replicated  # type: ignore[assignment]

        def pmap(function: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
            nonlocal n_found
            compiled = compiling(function, *arguments, **options)
            if getattr(function, "__name__", None) != EPOCH:
                return compiled
            n_found += 1
            return self.around(compiled)

        jax.pmap = pmap  # type: ignore[assignment]
        try:
            yield
        finally:
            jax.pmap = compiling
        assert n_found == 1, "Brax's PPO has changed: it no longer compiles its epoch by jax.pmap"


def replicated(state: Any, devices: Sequence[jax.Device]) -> Any:
    """As `jax.device_put_replicated`: one copy per device, along a new first axis."""
    sharding = NamedSharding(Mesh(np.array(devices), "device"), PartitionSpec("device"))
    return jax.tree.map(lambda leaf: jax.device_put(jax.numpy.stack([leaf] * len(devices)), sharding), state)
