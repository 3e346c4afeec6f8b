"""Where the machine would go, and how fast, under commands and explanations: the diagnosis model inside their chain."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.discrepancy.diagnosis.simulation import Hypothesis, Simulation, completed, stacked
from pipeline.discrepancy.experiment.player import PlanPlayer
from pipeline.effects.augmented_model import AugmentedHistory, AugmentedModel, AugmentedParameters
from pipeline.effects.chain import Chain, ChainValues

LONGEST_S = 3600.0  # of a plan that is played on the model: an hour


class Rollouts:
    """Free-running predictions from rest; a recording begins with them, so that cold oil is cold."""

    def __init__(self, simulation: Simulation, hypotheses: Sequence[Hypothesis]) -> None:
        """Of any hypotheses whose effects are among those of these."""
        families = sorted({family for of in hypotheses for family in of.values})
        types = [type(simulation.effects[family]) for family in families or list(simulation.effects)[:1]]
        self._chain = Chain(types, simulation.setting)
        self._model = AugmentedModel(simulation.model.model, self._chain)
        self._network = simulation.model.parameters
        self._run = jax.jit(self._rolled_out)
        self._step = jax.jit(lambda history, command: self._next(history, command, self._network))

    def positions(self, hypotheses: Sequence[Hypothesis], q: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Measured positions, (T + 1, M, H, n_joint), rad (m).

        Args:
            hypotheses: H of them.
            q: (M, n_joint) where each sequence begins at rest, as measured.
            commands: (T, M, n_joint).
        """
        values = self._values(hypotheses)
        begin = jnp.broadcast_to(jnp.asarray(q, jnp.float32)[:, None], (len(q), len(hypotheses), q.shape[1]))
        given = jnp.asarray(commands, jnp.float32)[:, :, None]
        visited = self._run(values, begin, jnp.broadcast_to(given, (len(commands), *begin.shape)))
        return np.concatenate([np.asarray(begin)[None], np.asarray(visited)]).astype(np.float64)

    def played(
        self, hypotheses: Sequence[Hypothesis], q: np.ndarray, players: Sequence[PlanPlayer]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions (T, H, n_joint), rad (m), commands of that shape, and steps (T, H), each player at its machine.

        Args:
            hypotheses: H of them.
            q: (n_joint,) where all begin at rest.
            players: One per hypothesis.
        """
        values = self._values(hypotheses)
        history = self._begin(
            values, jnp.broadcast_to(jnp.asarray(q, jnp.float32), (len(hypotheses), len(q)))
        )
        visited, given, steps = [], [], []
        for _ in range(round(LONGEST_S / self._chain.setting.dt_s)):
            at = np.asarray(history.q, np.float64)
            commands = np.stack([player.command(own) for player, own in zip(players, at, strict=True)])
            if all(player.is_done for player in players):
                break
            visited.append(at)
            given.append(commands)
            steps.append([player.step for player in players])
            history = self._step(history, jnp.asarray(commands, jnp.float32))
        return np.stack(visited), np.stack(given), np.array(steps)

    def _values(self, hypotheses: Sequence[Hypothesis]) -> ChainValues:
        """Of each hypothesis, (H, ...)."""
        return stacked([completed(self._chain.neutral(), of.values) for of in hypotheses])

    def _begin(self, values: ChainValues, q: jax.Array) -> AugmentedHistory:
        values = jax.tree.map(lambda of: jnp.broadcast_to(of, (*q.shape[:-2], *of.shape)), values)
        history = self._model.at_rest(AugmentedParameters(self._network, values), q)
        return history._replace(values=values, time_s=jnp.zeros_like(history.time_s))

    def _next(self, history: AugmentedHistory, command: jax.Array, network: dict) -> AugmentedHistory:
        return self._model.step(AugmentedParameters(network, {}), history, command)

    def _rolled_out(self, values: ChainValues, q: jax.Array, commands: jax.Array) -> jax.Array:
        def step(history: AugmentedHistory, command: jax.Array) -> tuple[AugmentedHistory, jax.Array]:
            after = self._next(history, command, self._network)
            return after, after.q

        return jax.lax.scan(step, self._begin(values, q), commands)[1]
