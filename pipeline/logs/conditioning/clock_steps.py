"""Steps of one clock against another, told from messages that come late.

A step changes the offset log time − header stamp at once and for good. Messages that are held up change it too, but the
ones after them come less and less late. So the offset has stepped up if it does not come down again by the log's end,
and has stepped down if it falls below all that came before. What lasts for less than a gap does not count.
"""

import itertools
from collections.abc import Iterator

import numpy as np

from pipeline.logs.conditioning.samples import Samples
from pipeline.logs.conditioning.stray_stamps import drop_stray_stamps
from pipeline.logs.messages.columns import Column, sections

Piece = tuple[int, int, int]  # the first, the least and the last offset between two sudden changes


def step_apart_ns(stamp_ns: Column, log_time_ns: Column, gap_ns: int) -> int:
    """Return a step of log time against header stamps that is longer than a gap, in ns; 0 without one.

    Args:
        stamp_ns: Header stamps, shape (N,), int64; zero where unset.
        log_time_ns: Shape (N,), int64.
        gap_ns: Longest pause within a trajectory.
    """
    before: Piece | None = None
    risen_from = rise = 0
    for first, least, last in _pieces(stamp_ns, log_time_ns, gap_ns):
        if before is not None and first < before[1] - gap_ns:
            return first - before[1]
        if rise and least <= risen_from + gap_ns:
            rise = 0
        if before is not None and not rise and least > before[2] + gap_ns:
            risen_from, rise = before[2], first - before[2]
        before = first, least if before is None else min(before[1], least), last
    return rise


def _pieces(stamp_ns: Column, log_time_ns: Column, gap_ns: int) -> Iterator[Piece]:
    """Yield the pieces of the log between sudden changes of the offset that last for more than a gap."""
    piece: Piece | None = None
    since = until = 0
    for log_time, offset in _offsets(stamp_ns, log_time_ns, gap_ns):
        is_sudden = np.abs(np.diff(offset, prepend=offset[0] if piece is None else piece[2])) > gap_ns
        for begin, end in itertools.pairwise([0, *np.flatnonzero(is_sudden).tolist(), len(offset)]):
            if begin or begin == end:  # a sudden change stands here
                if piece is not None and until - since > gap_ns:
                    yield piece
                piece = None
            if begin == end:
                continue
            first, least, until = int(offset[begin]), int(offset[begin:end].min()), int(log_time[end - 1])
            if piece is None:
                piece, since = (first, least, int(offset[end - 1])), int(log_time[begin])
            else:
                piece = piece[0], min(piece[1], least), int(offset[end - 1])
    if piece is not None and until - since > gap_ns:
        yield piece


def _offsets(stamp_ns: Column, log_time_ns: Column, gap_ns: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield log time, and log time − header stamp, of the samples that have both, and neither stray."""
    both = (Samples(stamp, log_time) for stamp, log_time in sections((stamp_ns, log_time_ns)))
    both = (
        one if one.time_ns.all() and one.value.all() else one[(one.time_ns != 0) & (one.value != 0)]
        for one in both
    )
    steady = drop_stray_stamps(both, gap_ns, "", "", [])
    steady = drop_stray_stamps((Samples(one.value, one.time_ns) for one in steady), gap_ns, "", "", [])
    return ((section.time_ns, section.time_ns - section.value) for section in steady if len(section))
