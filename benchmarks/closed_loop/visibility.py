"""How large an effect must be to be seen, from replays: the same states and commands, other chances.

Stretches of the measured sessions happen again, with the effect at its largest size and without it. The difference of
their displacements is what the effect does; the scatter of replays is what hides it. Both are taken to be in
proportion to the size, and stretches and joints to scatter independently. An effect is visible from the size on at
which somebody finds it with 90 % who knows what each of the catalogue's hypotheses would do, at 5 % false alarms over
all of them. A search that must learn the machine from logs first can do no better.
"""

from dataclasses import replace

import numpy as np
from scipy.stats import norm

from benchmarks.closed_loop.draw import Plan
from benchmarks.closed_loop.sessions import Session
from benchmarks.closed_loop.truth import TrueEffect, Truth

HORIZON = 80  # control periods of a stretch
N_STRETCH = 30  # in a session
N_PAIR = 2  # replays with and without
N_HYPOTHESIS = 100  # some: families and dependences on each joint
LEAST_Z = float(norm.isf(0.05 / N_HYPOTHESIS) + norm.isf(0.1))
READ_ONLY = ("sensor_bias", "timing")  # kinds that change readings, not motions: replays do not show them
REPLAYS = 50_2024  # seed


def with_visible_sizes(plan: Plan) -> Truth:
    """The plan's truth with the visible size of each effect."""
    if not plan.truth.effects:
        return plan.truth
    squares = np.sum([_squares(plan, session) for session in plan.measured], axis=0)
    effects = [
        effect if effect.kind in READ_ONLY else replace(effect, visible_size=visible_size(largest, of))
        for effect, largest, of in zip(plan.truth.effects, plan.largest, squares.tolist(), strict=True)
    ]
    return replace(plan.truth, effects=tuple(effects))


def visible_size(largest: float, squares: float) -> float:
    """From the squares of the effect's signature at its largest size, in units of the scatter."""
    return float(largest * LEAST_Z / np.sqrt(max(squares, 1e-6)))


def _squares(plan: Plan, session: Session) -> np.ndarray:
    """(n_effect,) squares of signatures over a session."""
    log = session.record()
    starts = np.linspace(HORIZON, len(log.commands) - HORIZON, N_STRETCH).astype(int)
    instead = [
        machine
        for pair in zip(plan.strongest, plan.without, strict=True)
        for machine in pair
        for _ in range(N_PAIR)
    ]
    replays = session.simulator.replay(
        session.parameters, log, session.seed, starts.tolist(), HORIZON, REPLAYS, session.changes, instead
    )
    seconds = starts / len(log.commands) * 60.0 * session.minutes
    acts = np.array([_acts(effect, session, plan, seconds) for effect in plan.truth.effects])
    ends = replays[:, :, -1].reshape(len(plan.without), 2, N_PAIR, N_STRETCH, -1)
    return signature_squares(ends, acts) * len(log.commands) / (N_STRETCH * HORIZON)


def _acts(effect: TrueEffect, session: Session, plan: Plan, seconds: np.ndarray) -> np.ndarray:
    """(n_stretch,) whether the effect has set in."""
    if effect.onset is None:
        return np.ones(len(seconds), bool)
    if effect.onset.trajectory == session.name:
        return seconds >= effect.onset.t
    is_later = session.start > min(s.start for s in plan.measured)
    return np.full(len(seconds), is_later and effect.onset.trajectory != session.name)


def signature_squares(ends: np.ndarray, acts: np.ndarray) -> np.ndarray:
    """Squares of what effects do, in units of the scatter's variance; chances cancel, as two pairs are multiplied.

    Args:
        ends: (n_effect, 2, N_PAIR, n_stretch, n_joint) displacements with and without each effect.
        acts: (n_effect, n_stretch) whether it has set in.
    """
    scatter = (ends[:, 1, 0] - ends[:, 1, 1]) / np.sqrt(2.0)
    std = np.sqrt(np.mean(scatter**2, axis=1, keepdims=True)) + 1e-9
    one, other = ((ends[:, 0, k] - ends[:, 1, k]) / std for k in range(N_PAIR))
    return np.asarray(np.sum(one * other * acts[..., None], axis=(1, 2)))
