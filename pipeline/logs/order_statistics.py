"""Exact quantiles of more values than are to be held in memory.

The values are passed over several times; each pass counts them in bins of the interval that is known to hold the
wanted one, until so few are left that they can be sorted.
"""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

SORTED_AT_ONCE = 1 << 16
N_BINS = 1 << 12

Parts = Callable[[], Iterable[np.ndarray]]


def quantiles(parts: Parts, fractions: Sequence[float]) -> list[float]:
    """Return quantiles, linear between neighbours as NumPy's default.

    Args:
        parts: Gives the values anew at each call, in arrays of shape (n,); none of them NaN.
        fractions: In [0, 1].

    Raises:
        ValueError: There are no values.
    """
    count = sum(len(part) for part in parts())
    if not count:
        raise ValueError("quantiles of no values")
    places = [fraction * (count - 1) for fraction in fractions]
    ranks = sorted({int(np.floor(place)) for place in places} | {int(np.ceil(place)) for place in places})
    if count <= SORTED_AT_ONCE:
        ordered = np.sort(np.concatenate([np.asarray(part, np.float64) for part in parts()]))
        value = {rank: float(ordered[rank]) for rank in ranks}
    else:
        value = {rank: _value_of_rank(parts, rank) for rank in ranks}
    result = []
    for place in places:
        low, high = value[int(np.floor(place))], value[int(np.ceil(place))]
        result.append(low + (place - np.floor(place)) * (high - low))
    return result


def _value_of_rank(parts: Parts, rank: int) -> float:
    """Return the value with `rank` values before it in ascending order."""
    low = min(float(part.min()) for part in parts() if len(part))
    high = max(float(part.max()) for part in parts() if len(part))
    while low < high:
        edges = np.unique(np.linspace(low, high, N_BINS + 1))
        inner = edges[1:-1]  # none where low and high are neighbouring doubles
        before, counts = 0, np.zeros(len(inner) + 1, np.int64)
        for values in _doubles(parts):
            before += int((values < low).sum())
            inside = values[(values >= low) & (values <= high)]
            places = np.searchsorted(inner, inside, side="right" if len(inner) else "left")
            counts += np.bincount(places, minlength=len(counts))
        place = int(np.searchsorted(np.cumsum(counts), rank - before, side="right"))
        rank_within = rank - before - int(counts[:place].sum())
        if place < len(inner):
            high = float(np.nextafter(inner[place], -np.inf))
        low = float(edges[place])
        if counts[place] <= SORTED_AT_ONCE or not len(inner):
            chosen = [values[(values >= low) & (values <= high)] for values in _doubles(parts)]
            return float(np.sort(np.concatenate(chosen))[rank_within])
    return low


def _doubles(parts: Parts) -> Iterable[np.ndarray]:
    return (np.asarray(part, np.float64) for part in parts())
