"""Which measured rows are for fitting, for selection and for confirmation; no row is for two of them."""

import enum
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.errors import InputError


class Purpose(enum.IntEnum):
    """What a row may be used for."""

    purged = 0
    fit = 1
    select = 2
    confirm = 3


@dataclass
class SplitConfig:
    """How measured rows are split.

    Attributes:
        block_s: Length of a block where the logs are long enough.
        smallest_block_s: Blocks are not made shorter.
        blocks: Number of blocks wanted over all logs.
        trajectories: From so many trajectories on, whole trajectories are split instead of blocks, if each purpose gets
            its part of the rows then.
        purge_s: Left out between blocks of different purposes: longer than a window of history and horizon.
    """

    block_s: float
    smallest_block_s: float
    blocks: int
    trajectories: int
    purge_s: float

    def __post_init__(self) -> None:
        if not 0 < self.smallest_block_s <= self.block_s:
            raise InputError("close_loop.split: 0 < smallest_block_s <= block_s must hold")
        if not 0 <= self.purge_s < self.smallest_block_s:
            raise InputError("close_loop.split.purge_s must be between 0 and smallest_block_s")


CYCLE = (Purpose.fit, Purpose.select, Purpose.confirm)
# Of a third of the rows, which every purpose gets of whole trajectories, or they are cut: the pieces of a log that
# gaps cut in two are no trajectories of like length, and a purpose of the small ones has too few rows to tell by.
SMALLEST_PART = 0.5
# Of a block: parts are made more even by so much at least, not by what rounding and purging make; and how uneven they
# may become so, which many logs shorter than a block would add up to.
WORTH_IT = 0.5
UNEVEN = 1.0


def split_rows(lengths: Sequence[int], dt_s: float, config: SplitConfig) -> tuple[list[np.ndarray], str]:
    """Purpose of every row of every trajectory.

    Args:
        lengths: Rows of each trajectory.
        dt_s: Length of one time step.
        config: See there.

    Returns:
        Per trajectory (T,) int8 of `Purpose`, and the rule in words.
    """
    if len(lengths) >= config.trajectories:
        whole = _whole_trajectories(lengths)
        if _counts(whole).min() >= SMALLEST_PART * sum(lengths) / len(CYCLE):
            return whole, "whole trajectories, by length in turn: fit, select, confirm"
    total_s = sum(lengths) * dt_s
    block_s = float(np.clip(total_s / config.blocks, config.smallest_block_s, config.block_s))
    purposes: list[np.ndarray] = []
    so_far = np.zeros(len(CYCLE), int)
    for number, length in enumerate(lengths):
        # Logs begin with different purposes, as drifts show there; of two logs of six blocks each, the last two blocks
        # hold one to confirm, beside one to find on what sets in late. Where logs are of different length, or shorter
        # than a block, they begin with what makes the parts most even.
        begun = [
            _blocks(length, number + shift, dt_s, block_s, config.purge_s) for shift in range(len(CYCLE))
        ]
        counts = [so_far + _counts([rows]) for rows in begun]
        unevenness = np.array([np.ptp(of) for of in counts]) * dt_s / block_s
        best = int(np.argmin(unevenness))
        if unevenness[0] - unevenness[best] < WORTH_IT and unevenness[0] <= UNEVEN:
            best = 0
        purposes.append(begun[best])
        so_far = counts[best]
    return purposes, (
        f"blocks of {block_s:.0f} s in turn: fit, select, confirm; after each boundary {config.purge_s:g} s "
        "belong to none"
    )


def _whole_trajectories(lengths: Sequence[int]) -> list[np.ndarray]:
    """The longest is for fitting, the next for selection, and so on."""
    purposes = [np.zeros(0, np.int8)] * len(lengths)
    for place, index in enumerate(np.argsort([-length for length in lengths], kind="stable")):
        purposes[index] = np.full(lengths[index], CYCLE[place % len(CYCLE)], np.int8)
    return purposes


def _blocks(length: int, first: int, dt_s: float, block_s: float, purge_s: float) -> np.ndarray:
    """(T,) blocks of about `block_s` in turn, the first one for the purpose `first` of the cycle."""
    n_blocks = max(1, round(length * dt_s / block_s))
    edges = np.round(np.linspace(0, length, n_blocks + 1)).astype(int)
    rows = np.zeros(length, np.int8)
    for block, (begin, end) in enumerate(itertools.pairwise(edges)):
        rows[begin:end] = CYCLE[(block + first) % len(CYCLE)]
        if block:
            rows[begin : begin + round(purge_s / dt_s)] = Purpose.purged
    return rows


def _counts(purposes: Sequence[np.ndarray]) -> np.ndarray:
    """(3,) rows of each purpose."""
    return np.sum([np.bincount(rows, minlength=len(Purpose))[1:] for rows in purposes], axis=0)
