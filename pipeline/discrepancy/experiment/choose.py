"""Which manoeuvres, and how often: greedily, whatever makes errors least probable per second of motion."""

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.discrepancy.experiment.evidence import PairSums, log_error_bound
from pipeline.discrepancy.experiment.manoeuvres import Manoeuvre

SMALLEST_COST_S = 1.0  # a manoeuvre without motion takes time, too
WORTH_IT = 1e-3  # of the logarithm of the bound


def choose(
    manoeuvres: Sequence[Manoeuvre],
    sums: Mapping[int, Sequence[PairSums]],
    speed: np.ndarray,
    motion_s: float,
    rounds: int,
) -> list[int]:
    """Indices of the manoeuvres of one round, in order.

    Args:
        manoeuvres: All.
        sums: Of those that may be chosen, by pair.
        speed: (n_joint,) usual speeds, rad/s (m/s), which the way from one to the next takes.
        motion_s: Seconds of motion of all rounds.
        rounds: How often the round is played.
    """
    chosen: list[int] = []
    if not sums:
        return chosen
    total = [PairSums(0.0, np.zeros_like(of.c), np.zeros_like(of.g)) for of in next(iter(sums.values()))]
    left_s = motion_s / rounds
    while True:
        before = log_error_bound(total)
        best, best_worth = None, 0.0
        for index, of in sums.items():
            cost_s = manoeuvres[index].motion_s + _way_s(manoeuvres, [*chosen, index], speed)
            if index in chosen or cost_s > left_s:
                continue
            after = log_error_bound([t.plus(o.times(rounds)) for t, o in zip(total, of, strict=True)])
            worth = (before - after) / max(cost_s, SMALLEST_COST_S)
            if before - after > WORTH_IT and worth > best_worth:
                best, best_worth = index, worth
        if best is None:
            return _in_order(manoeuvres, chosen)
        left_s -= manoeuvres[best].motion_s + _way_s(manoeuvres, [*chosen, best], speed)
        chosen.append(best)
        total = [t.plus(o.times(rounds)) for t, o in zip(total, sums[best], strict=True)]


def _way_s(manoeuvres: Sequence[Manoeuvre], chosen: Sequence[int], speed: np.ndarray) -> float:
    """Seconds from where the last one began to where the new one does; back, too, for the next round."""
    if len(chosen) < 2:
        return 0.0
    *before, new = chosen
    ways = [float(np.max(np.abs(manoeuvres[new].q - manoeuvres[of].q) / speed)) for of in before]
    return 2.0 * min(ways)


def _in_order(manoeuvres: Sequence[Manoeuvre], chosen: Sequence[int]) -> list[int]:
    """Those of one place after the other."""
    places = list(dict.fromkeys(manoeuvres[of].q.tobytes() for of in chosen))
    return sorted(chosen, key=lambda of: places.index(manoeuvres[of].q.tobytes()))
