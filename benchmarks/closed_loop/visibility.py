"""How large an effect must be to be seen, from replays: the same states and commands, other chances.

Stretches of the measured sessions happen again, with the effect and without it. Their mean difference is what the
effect does; the scatter of replays is what hides it. Who knew exactly what to look for would estimate the effect's size
with a standard deviation that follows from both. An effect is visible from the size on that such a search finds with
90 %, at 5 % false alarms over as many hypotheses as the catalogue has. No search on logs alone can do better.
"""

from dataclasses import replace

import numpy as np
from scipy.stats import norm

from benchmarks.closed_loop.draw import Plan
from benchmarks.closed_loop.sessions import Session
from benchmarks.closed_loop.truth import Truth

HORIZON, EVERY = 80, 8  # control periods of a stretch, and of which those are compared
N_STRETCH = 30  # in a session
N_REPLAY = 2
N_HYPOTHESIS = 100  # some: families and dependences on each joint
LEAST_Z = float(norm.isf(0.05 / N_HYPOTHESIS) + norm.isf(0.1))
READ_ONLY = ("sensor_bias", "timing")  # kinds that change readings, not motions: replays do not show them
REPLAYS = 50_2024  # seed


def with_visible_sizes(plan: Plan) -> Truth:
    """The plan's truth with the visible size of each effect."""
    effects = [
        effect if effect.kind in READ_ONLY else replace(effect, visible_size=effect.size / max(times, 1e-3))
        for effect, times in zip(plan.truth.effects, _times_visible(plan), strict=True)
    ]
    return replace(plan.truth, effects=tuple(effects))


def _times_visible(plan: Plan) -> np.ndarray:
    """(n_effect,) how many times larger than visible each effect is."""
    if not plan.without:
        return np.zeros(0)
    parts = [_signal_and_scatter(plan, session) for session in plan.measured]
    signal, scatter = np.sum(parts, axis=0)
    return np.asarray(signal / np.sqrt(np.maximum(scatter, 1e-12)) / LEAST_Z)


def _signal_and_scatter(plan: Plan, session: Session) -> np.ndarray:
    """(2, n_effect) squares of the effects' signatures, and of scatter along them, over a session's stretches."""
    log = session.record()
    starts = np.linspace(HORIZON, len(log.commands) - HORIZON, N_STRETCH).astype(int).tolist()
    instead = [None] * N_REPLAY + [machine for machine in plan.without for _ in range(N_REPLAY)]
    replays = session.simulator.replay(
        session.parameters, log, session.seed, starts, HORIZON, REPLAYS, session.changes, instead
    )
    return signal_and_scatter(replays[:, :, EVERY - 1 :: EVERY], len(log.commands) / (N_STRETCH * HORIZON))


def signal_and_scatter(replays: np.ndarray, n_unseen: float) -> np.ndarray:
    """See `_signal_and_scatter`.

    Args:
        replays: (N_REPLAY (1 + n_effect), n_stretch, n_time, n_joint) displacements: first of the machine as it is,
            then of those that lack one effect.
        n_unseen: How many times longer the session is than its stretches together.
    """
    paired = replays.reshape(-1, N_REPLAY, *replays.shape[1:])
    half_difference = 0.5 * (paired[0, 0] - paired[0, 1])
    std = np.sqrt(2.0 * np.mean(half_difference**2, axis=(0, 1), keepdims=True)) + 1e-9
    signature = (paired[0].mean(axis=0) - paired[1:].mean(axis=1)) / std
    scatter = np.sqrt(2.0) * half_difference / std
    n_chance = signature[0].size * 2.0 / N_REPLAY  # squares that chance alone leaves in a signature
    signal = np.maximum(np.sum(signature**2, axis=(1, 2, 3)) - n_chance, 0.0)
    along = np.sum(signature * scatter, axis=(2, 3))
    return n_unseen * np.stack([signal, np.sum(along**2, axis=1)])
