"""Two joints whose nominal speed is exactly their command's, and logs of them with what changes it."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import jax
import numpy as np

from pipeline.discrepancy.diagnosis.channels import channels_of
from pipeline.discrepancy.diagnosis.sequences import Sequences
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.effect import Setting

DT_S, N_JOINT = 0.05, 2
SPEED = np.array([0.4, 0.6])
SETTING = Setting(DT_S, np.full(N_JOINT, -1.0), np.full(N_JOINT, 1.0), SPEED)
STEP_NS = round(1e9 * DT_S)


class ExactModel:
    """A diagnosis model of a single member that moves as it is told, and meets no stops."""

    left_out = np.zeros((1, 1, 1), bool)

    def velocity(self, command: jax.Array, q: jax.Array) -> jax.Array:
        """(..., n_joint)."""
        return SPEED * command

    def members_velocity(self, command: jax.Array, q: jax.Array) -> jax.Array:
        """(1, ..., n_joint)."""
        return self.velocity(command, q)[None]

    def stopped(self, velocity: jax.Array, q: jax.Array) -> jax.Array:
        """As it comes."""
        return velocity


def held_commands(seed: int, n_rows: int) -> np.ndarray:
    """(T, n_joint) holds of ten rows."""
    random = np.random.default_rng(seed)
    return np.repeat(random.choice([-1.0, 0.0, 1.0], (n_rows // 10, N_JOINT)), 10, axis=0)


def simulation_of(
    families: list[str],
    command: np.ndarray,
    velocity: np.ndarray,
    channels: Mapping[str, np.ndarray] | None = None,
) -> Simulation:
    """Of one log, (T, n_joint) each, and channels (T,)."""
    n_rows = len(command)
    t_s = DT_S * np.arange(n_rows)
    sequences = Sequences(
        command[None],
        np.zeros((1, n_rows, N_JOINT)),
        velocity[None],
        t_s[None],
        STEP_NS * np.arange(n_rows)[None],
        np.ones((1, n_rows), bool),
        np.array(list((channels or {}).values())).reshape(-1, 1, n_rows).transpose(1, 2, 0),
    )
    model: Any = ExactModel()
    setting = replace(SETTING, channels=channels_of(sequences, sequences, list(channels or {}), DT_S))
    return Simulation(model, sequences, [KNOWN[family] for family in families], setting)
