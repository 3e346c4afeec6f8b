"""Rollouts of many command sequences from one history, without rolling a window per sample.

The first layer of the network is a sum over the rows of its window (`network.py`), so that its parts separate:

- what the measured history contributes, tick by tick, as its rows leave the window: the same for all sequences,
  computed once;
- what held commands contribute: the rows of the kernel that one held entry covers are added beforehand, so that
  18 lags of commands held for four ticks are six rows instead of nineteen;
- what the predicted motion and configuration contribute: rows of the newest predictions, as many as there are.

Equal to stepping the model, up to rounding.
"""

from functools import cache, partial
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.features import History
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.model.rollouts.held_command import by_held_commands
from pipeline.dynamics.model.stepwise_model import StepwiseModel
from pipeline.dynamics.model.stops import Stops

# While the window still fills with predictions, the loop is cut into so many pieces, each with a product of its
# size: more of them save little and take longer to compile.
FILLING_PIECES = 4


class _Carry(NamedTuple):
    motion: (
        jax.Array
    )  # (N, rows, expanded row), predictions, normalised and expanded, oldest first, zero before
    newest: jax.Array  # (N, n_joint)
    q: jax.Array  # (N, n_joint)


class _Piece(NamedTuple):
    """Entries whose ticks share the shape of the first layer.

    Attributes:
        begin: first entry.
        end: after the last one.
        n_motion: rows of predicted motion in the window.
        n_recent: entries in the window of commands.
        kernels: first layer per phase, (ticks per entry, rows, width).
    """

    begin: int
    end: int
    n_motion: int
    n_recent: int
    kernels: np.ndarray


class HeldRollout:
    """Configurations that sequences of held commands lead to from one history."""

    def __init__(
        self, model: StepwiseModel, parameters: Parameters, n_steps: int, stops: Stops | None = None
    ) -> None:
        """Splits the first layer; arguments as of `Dynamics.held_rollout`."""
        specification, network = model.specification, model.network
        first, *self._others = network.layers(parameters)
        self._model, self._stops, self._held = model, stops, n_steps
        self._lags = specification.lags
        self._row = specification.n_joint * network.expansion  # expanded values per row
        self._n_past = -(-self._lags // n_steps)  # entries in the window before the acting one
        window = self._row * (self._lags + 1)
        self._bias = first.bias
        self._by_motion, self._by_commands = first.kernel[:window], first.kernel[window : 2 * window]
        self._kernels = np.split(np.asarray(first.kernel), [window, 2 * window])  # of motion, commands and q
        self._pieces = cache(
            self._cut
        )  # kept: compiled calls with equally many entries share their constants

    def __call__(self, history: History, commands: jax.Array) -> jax.Array:
        """Configurations after each tick, (H, ticks per entry, N, n_joint), of commands (N, H, n_joint)."""
        n, n_entries, _ = commands.shape
        entries = self._model.network.expand(jnp.swapaxes(commands, 0, 1))
        entries = jnp.pad(entries, ((self._n_past, 0), (0, 0), (0, 0)))
        shared_ticks = self._shared(history, n_entries * self._held).reshape(n_entries, self._held, -1)
        newest = history.motion[-1]
        carry = _Carry(
            motion=jnp.zeros((n, 0, self._row), commands.dtype),
            newest=jnp.broadcast_to(newest, (n, *newest.shape)),
            q=jnp.broadcast_to(history.q, (n, *history.q.shape)),
        )
        visited = []
        for piece in self._pieces(n_entries):
            carry = carry._replace(motion=_with_rows(carry.motion, piece.n_motion))
            oldest = jnp.arange(piece.begin, piece.end) + self._n_past + 1 - piece.n_recent
            at = (oldest, shared_ticks[piece.begin : piece.end])
            carry, q = jax.lax.scan(partial(self._entry, entries, piece), carry, at)
            visited.append(q)
        return jnp.concatenate(visited)

    def _shared(self, history: History, n_ticks: int) -> jax.Array:
        """The first layer's output from the measured rows and the bias alone, (n_ticks, width)."""
        model = self._model
        motion = model.network.expand(model.normalise_motion(history.motion))
        commands = model.network.expand(history.commands)
        # At tick t the window holds measured motion from row t on, and measured commands from row t + 1 on.
        windows = [windows_of(rows, n_ticks) for rows in (motion, commands[1:])]
        padded = jnp.pad(windows[1], ((0, 0), (0, self._row)))  # its last row is the command of tick t
        return self._bias + windows[0] @ self._by_motion + padded @ self._by_commands

    def _entry(
        self, entries: jax.Array, piece: _Piece, carry: _Carry, at: tuple[jax.Array, jax.Array]
    ) -> tuple[_Carry, jax.Array]:
        """The ticks of one entry.

        Args:
            entries: all, expanded, (·, N, expanded row).
            piece: that the entry is in.
            carry: before.
            at: index of the oldest entry that the window still sees, and the shared part of the ticks.

        Returns:
            Carry after, and the configurations after each tick.
        """
        model = self._model
        n, (oldest, shared) = len(carry.motion), at
        recent = jax.lax.dynamic_slice_in_dim(entries, oldest, piece.n_recent)
        recent = jnp.swapaxes(recent, 0, 1).reshape(n, -1)

        def tick(carry: _Carry, at: tuple[jax.Array, jax.Array]) -> tuple[_Carry, jax.Array]:
            motion, newest, q = carry
            kernel, shared = at
            position = model.network.expand(model.normalise_position(q))
            y = jnp.concatenate([motion.reshape(n, -1), recent, position], axis=1) @ kernel + shared
            q, newest, _ = model.finish_step(self._others, y, q, newest, self._stops)
            predicted = model.network.expand(model.normalise_motion(newest))
            motion = jnp.concatenate([motion[:, 1:], predicted[:, None]], axis=1)
            return _Carry(motion, newest, q), q

        return jax.lax.scan(tick, carry, (jnp.asarray(piece.kernels), shared))

    def _cut(self, n_entries: int) -> list[_Piece]:
        """The loop's pieces: some while the window fills with predictions, one thereafter."""
        by_motion, by_commands, by_q = self._kernels
        n_rows, width = self._lags + 1, by_commands.shape[-1]
        newest_first = by_commands.reshape(n_rows, -1)[::-1]
        by_entries = by_held_commands(newest_first, np.arange(n_rows), self._held)[:, ::-1]
        by_entries = by_entries.reshape(self._held, -1, width)  # oldest first
        filling = min(n_entries, -(-(self._lags + 1) // self._held))
        bounds = np.unique(np.linspace(0, filling, FILLING_PIECES + 1).round().astype(int)).tolist()
        pieces = []
        for begin, end in pairwise(dict.fromkeys([*bounds, n_entries])):
            n_motion, n_recent = min(self._lags + 1, end * self._held), min(self._n_past + 1, end)
            motion = by_motion[len(by_motion) - n_motion * self._row :]
            recent = by_entries[:, by_entries.shape[1] - n_recent * self._row :]
            kernels = np.stack([np.concatenate([motion, of_phase, by_q]) for of_phase in recent])
            pieces.append(_Piece(begin, end, n_motion, n_recent, kernels))
        return pieces


def windows_of(rows: jax.Array, n_ticks: int) -> jax.Array:
    """(n_ticks, rows · width): the rows from the t-th on, then zeros."""
    n_rows = rows.shape[0]
    padded = jnp.pad(rows, ((0, n_ticks), (0, 0)))
    return padded[np.arange(n_ticks)[:, None] + np.arange(n_rows)].reshape(n_ticks, -1)


def _with_rows(motion: jax.Array, rows: int) -> jax.Array:
    """The rows with as many of zeros before them as are missing."""
    return jnp.pad(motion, ((0, 0), (rows - motion.shape[1], 0), (0, 0)))
