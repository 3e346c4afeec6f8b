"""Sizes of effects: the 4 s error of the affected joints is to grow by a factor that is drawn in [1.3, 3].

The factor is measured with the variant's own baseline on sessions like the measured ones with the effect, against
the yardstick's error on the sound machine, as the mean over the affected joints. On sessions of 6 minutes of one and
the same sound machine a joint's error scatters by 12 % and sometimes doubles, so the yardstick is 36 minutes and a
trial 12. Where an effect cannot reach its factor within the simulator's bounds, the nearest is taken; the factor
reached stands in the truth.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.closed_loop.draw import MEASURED_MINUTES, Size
from benchmarks.closed_loop.machines import FIRST_DAY, Variant
from benchmarks.closed_loop.sessions import Session, machine
from benchmarks.closed_loop.yardstick import yardstick

LEAST_RATIO, LARGEST_RATIO = 1.3, 3.0
TOLERANCE = 0.08  # of the ratio: what chance does to it
N_TRIAL = 4  # recordings per effect
TYPICAL_RATIO = 2.5  # at size 1; gives the first size to try
SMALLEST_SIZE = 0.05
LARGEST_STEP = 4.0  # of the size from one trial to the next
LEAST_GROWTH = 0.02  # of the squared error; below, chance decides its sign


def wanted_ratio(share: float, half: bool) -> float:
    """The ratio for a uniform draw `share` in [0, 1), log-uniform in [1.3, 3]; half the growth for `half`."""
    ratio = LEAST_RATIO * (LARGEST_RATIO / LEAST_RATIO) ** share
    return 1.0 + 0.5 * (ratio - 1.0) if half else ratio


@dataclass(frozen=True)
class Calibration:
    """Chooses sizes with the baselines kept below `root`; see `draw.Calibrate`."""

    root: Path

    def __call__(self, of: Variant, kind: str, seed: int, share: float, half: bool) -> Size:
        """The size at which the error ratio is the wanted one."""
        ruler = yardstick(self.root, of)
        chances = np.random.SeedSequence(seed).generate_state(len(MEASURED_MINUTES)).tolist()

        def ratio_at(size: float) -> float:
            effect = of.simulator.draw_effect(kind, seed, of, size)
            sessions = [
                Session(
                    of.simulator, effect.apply(of.parameters), (), of.style_seed, chance, minutes, FIRST_DAY
                )
                for chance, minutes in zip(chances, MEASURED_MINUTES, strict=True)
            ]
            return affected_ratio(ruler.errors(sessions) / ruler.floor, effect.joints)

        wanted = wanted_ratio(share, half)
        first = math.sqrt((wanted**2 - 1.0) / (TYPICAL_RATIO**2 - 1.0))
        largest = of.simulator.largest_size[kind]
        if kind in of.simulator.often_unseen:
            first = largest
        size, ratio = solve_size(ratio_at, wanted, first, SMALLEST_SIZE, largest)
        return Size(size, wanted, ratio)


def affected_ratio(ratios: np.ndarray, joints: tuple[str, ...]) -> float:
    """Mean of the affected joints' ratios, of (n_joint,); of all joints where an effect is too weak to name any."""
    names = machine().joint_names
    return float(np.mean([ratios[names.index(joint)] for joint in joints or names]))


def solve_size(
    ratio_at: Callable[[float], float], wanted: float, first: float, smallest: float, largest: float
) -> tuple[float, float]:
    """The size in [smallest, largest] whose error ratio comes nearest to the wanted one.

    An effect adds to the squared error about as the square of its size, so the search is a secant in the
    logarithms of size and of the growth of the squared error, which begins with slope two.

    Returns:
        Size and the ratio there.
    """
    tried: list[tuple[float, float]] = []
    size = min(first, largest)
    for _ in range(N_TRIAL):
        tried.append((size, ratio_at(size)))
        if abs(tried[-1][1] / wanted - 1.0) < TOLERANCE:
            break
        size = min(max(_next_size(tried, wanted), smallest), largest)
        if any(math.isclose(size, earlier, rel_tol=0.01) for earlier, _ in tried):
            break
    return min(tried, key=lambda trial: abs(math.log(trial[1] / wanted)))


def _next_size(tried: list[tuple[float, float]], wanted: float) -> float:
    def growth(ratio: float) -> float:
        return math.log(max(ratio**2 - 1.0, LEAST_GROWTH))

    below = [trial for trial in tried if trial[1] < wanted]
    above = [trial for trial in tried if trial[1] >= wanted]
    size, ratio = tried[-1]
    if below and above:
        (low, low_ratio), (high, high_ratio) = max(below), min(above)
        if low >= high or growth(high_ratio) == growth(low_ratio):
            return math.sqrt(low * high)
        share = (growth(wanted) - growth(low_ratio)) / (growth(high_ratio) - growth(low_ratio))
        return low * (high / low) ** min(max(share, 0.1), 0.9)
    step = math.exp(0.5 * (growth(wanted) - growth(ratio)))
    return size * min(max(step, 1.0 / LARGEST_STEP), LARGEST_STEP)
