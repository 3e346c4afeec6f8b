"""Where in the envelope joints have a free way, among the configurations that nominal logs visited."""

import numpy as np

from pipeline.discrepancy.experiment.manoeuvres import Place
from pipeline.machine.workspace import Envelope

TRIED = 400  # visited configurations
PARTS = 40  # of a joint's range, in which its way is probed
USUAL = (0.02, 0.98)  # quantiles of visited positions: beyond them the model has seen little


def places_for(
    envelope: Envelope, visited: np.ndarray, margin: np.ndarray, limits: tuple[np.ndarray, np.ndarray]
) -> list[list[Place]]:
    """Per joint the configuration with the longest way both ways, and one that all joints share; best first.

    Args:
        envelope: Which no way leaves.
        visited: (N, n_joint) of nominal logs, rad (m).
        margin: (n_joint,) that every way keeps from the envelope, rad (m).
        limits: (n_joint,) lower and upper, rad (m).
    """
    n_joint = visited.shape[1]
    q = visited[np.linspace(0, len(visited) - 1, TRIED).astype(int)]
    lowest, highest = np.quantile(visited, USUAL, axis=0)
    inside = envelope.holds_each(q) & ((q >= lowest) & (q <= highest)).all(axis=1)
    q = q[inside]
    if not len(q):
        return [[] for _ in range(n_joint)]
    ways = np.stack(
        [_free_way(envelope, q, joint, margin, limits) for joint in range(n_joint)], axis=1
    )  # (n, n_joint, 2)
    shorter = ways.min(axis=2) / (highest - lowest)
    shared = int(np.argmax(shorter.min(axis=1)))
    found = []
    for joint in range(n_joint):
        own = int(np.argmax(ways[:, joint].min(axis=1)))
        chosen = [at for at in dict.fromkeys((shared, own)) if ways[at, joint].max() > 0.0]
        found.append([Place(q[at], joint, *ways[at, joint].tolist()) for at in chosen])
    return found


def _free_way(
    envelope: Envelope, q: np.ndarray, joint: int, margin: np.ndarray, limits: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """(n, 2) how far a joint can move down and up from each configuration, rad (m)."""
    lower, upper = limits[0][joint], limits[1][joint]
    levels = np.linspace(lower, upper, PARTS + 1)
    probes = np.repeat(q[:, None], len(levels), axis=1)
    probes[..., joint] = levels
    free = np.ones(probes.shape[:2], bool)
    for shift in corners(margin):
        free &= envelope.holds_each(probes + shift)
    step = levels[1] - levels[0]
    ways = np.zeros((len(q), 2))
    at = np.clip(((q[:, joint] - lower) / step).round().astype(int), 0, PARTS)
    for row, place in enumerate(at.tolist()):
        if not free[row, place]:
            continue
        blocked = np.flatnonzero(~free[row])
        low = max((b for b in blocked.tolist() if b < place), default=-1) + 1
        high = min((b for b in blocked.tolist() if b > place), default=PARTS + 1) - 1
        ways[row] = max(q[row, joint] - levels[low], 0.0), max(levels[high] - q[row, joint], 0.0)
    return ways


def corners(margin: np.ndarray) -> np.ndarray:
    """(2^n, n_joint) shifts by the margin, either way in every joint."""
    n = len(margin)
    signs = 2.0 * ((np.arange(2**n)[:, None] >> np.arange(n)) & 1) - 1.0
    return signs * margin
