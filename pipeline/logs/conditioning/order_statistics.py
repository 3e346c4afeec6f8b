"""Exact quantiles of more values than fit into memory.

The values are read in several passes. Each pass counts them in bins of the interval that holds the quantile, until few
enough are left to be sorted.
"""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

SORTED_AT_ONCE = 1 << 18
N_BINS = 1 << 12

Parts = Callable[[], Iterable[np.ndarray]]


def quantiles(parts: Parts, fractions: Sequence[float]) -> list[float]:
    """Return quantiles, linear between neighbours as NumPy's default.

    Args:
        parts: Yields all values at each call, in arrays of shape (n,), without NaN.
        fractions: In [0, 1].

    Raises:
        ValueError: `parts` yields no value.
    """
    count = sum(len(part) for part in parts())
    if not count:
        raise ValueError("quantiles of no values")
    places = [fraction * (count - 1) for fraction in fractions]
    ranks = sorted({int(np.floor(place)) for place in places} | {int(np.ceil(place)) for place in places})
    if count <= SORTED_AT_ONCE:
        ordered = np.partition(np.concatenate(list(_doubles(parts))), ranks)
        value = {rank: float(ordered[rank]) for rank in ranks}
    else:
        value = {rank: _value_of_rank(parts, rank) for rank in ranks}
    result = []
    for place in places:
        low, high = value[int(np.floor(place))], value[int(np.ceil(place))]
        result.append(low + (place - np.floor(place)) * (high - low))
    return result


def _value_of_rank(parts: Parts, rank: int) -> float:
    """Return the value at position `rank` in ascending order, from 0."""
    low = min(float(part.min()) for part in parts() if len(part))
    high = max(float(part.max()) for part in parts() if len(part))
    while low < high:
        before, counts = 0, np.zeros(N_BINS, np.int64)
        lowest, highest = np.full(N_BINS, np.inf), np.full(N_BINS, -np.inf)
        for values in _doubles(parts):
            before += int((values < low).sum())
            inside = values[(values >= low) & (values <= high)]
            # Any ascending bins would do; those of equal width are found by a division.
            bins = np.minimum((inside - low) / (high - low) * N_BINS, N_BINS - 1).astype(np.int64)
            counts += np.bincount(bins, minlength=N_BINS)
            np.minimum.at(lowest, bins, inside)
            np.maximum.at(highest, bins, inside)
        place = int(np.searchsorted(np.cumsum(counts), rank - before, side="right"))
        low, high = float(lowest[place]), float(highest[place])
        if counts[place] <= SORTED_AT_ONCE:
            chosen = [values[(values >= low) & (values <= high)] for values in _doubles(parts)]
            rank_within = rank - before - int(counts[:place].sum())
            return float(np.partition(np.concatenate(chosen), rank_within)[rank_within])
    return low


def _doubles(parts: Parts) -> Iterable[np.ndarray]:
    return (np.asarray(part, np.float64) for part in parts())


def widened(
    low: np.ndarray, high: np.ndarray, values: np.ndarray, counts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the extents (k,) widened to the values (k, n) that count, (k, n)."""
    least = np.where(counts, values, np.inf).min(axis=1, initial=np.inf)
    most = np.where(counts, values, -np.inf).max(axis=1, initial=-np.inf)
    return np.minimum(low, least), np.maximum(high, most)
