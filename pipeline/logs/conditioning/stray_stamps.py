"""Stray stamps: a few that lie far from those before and after them, while these agree.

The file's order is the order of recording, so samples with stray stamps were taken between their neighbours. One is
stray if its neighbours are at most a gap apart. Several in a row also need the time for it: as many intervals directly
before them must not take longer. So blocks that are stored out of order do not count, as no time passes at their place.
At a log's ends there is no second neighbour: a step back there is one of the clock.
"""

import itertools
from collections.abc import Iterable, Iterator

import numpy as np

from pipeline.logs.conditioning.samples import Samples, join
from pipeline.logs.messages.columns import Column, sections
from pipeline.logs.messages.raw_log import Note, NoteKind

FIRST_LOOK = 64  # samples; twice as many each time that they all lie within a gap


def drop_stray_stamps(
    stream: Iterable[Samples], gap_ns: int, what: str, clock_name: str, notes: list[Note]
) -> Iterator[Samples]:
    """Drop samples with a stray stamp."""
    count = 0
    for section, is_stray in _judged(stream, gap_ns):
        count += int(is_stray.sum())
        yield section[~is_stray] if is_stray.any() else section
    if count:
        text = f"{what}: their {clock_name} lies far from both neighbours'"
        notes.append(Note(NoteKind.left_out, text, count))


def steady_stamps(time_ns: Column, gap_ns: int) -> Iterator[np.ndarray]:
    """Yield the stamps of a column that are not stray, section by section."""
    stream = (Samples(part, part) for (part,) in sections((time_ns,)))
    return (section.time_ns for section in drop_stray_stamps(stream, gap_ns, "", "", []))


def _judged(stream: Iterable[Samples], gap_ns: int) -> Iterator[tuple[Samples, np.ndarray]]:
    """Yield parts of a stream, and which of their stamps are stray, shape (n,), bool."""
    before = np.zeros(0, np.int64)  # what counts of the stamps that are decided
    waiting: Samples | None = None  # for those that follow
    for section in itertools.chain(stream, [None]):
        if section is not None and len(section):
            waiting = section if waiting is None else join([waiting, section])
        if waiting is None or (section is not None and not len(section)):
            continue
        time_ns = np.concatenate([before, waiting.time_ns])
        is_stray, n_decided = _stray(time_ns, gap_ns, section is None)
        n_new = n_decided - len(before)
        if n_new:
            yield waiting[:n_new], is_stray[len(before) : n_decided]
        before = _last_stretch(time_ns[:n_decided], gap_ns)
        waiting = waiting[n_new:] if n_new < len(waiting) else None


def _stray(time_ns: np.ndarray, gap_ns: int, is_end: bool) -> tuple[np.ndarray, int]:
    """Return which stamps are stray, shape (n,), bool, and of how many this is certain whatever follows."""
    time = time_ns.astype(np.float64)  # differences of damaged stamps may overflow int64
    is_stray = np.zeros(len(time), bool)
    last = np.flatnonzero(np.abs(np.diff(time)) > gap_ns)  # rows before a step
    begin = np.append(0, last + 1)[:-1]
    beyond = time[np.minimum(last + 2, len(time) - 1)]
    may_begin = (np.abs(beyond - time[last]) <= gap_ns) | (last - begin > 1) | (last + 2 == len(time))
    for row, first in zip(last[may_begin].tolist(), begin[may_begin].tolist(), strict=True):
        if is_stray[row]:
            continue
        n_before = len(_last_stretch(time[first : row + 1], gap_ns)) - 1
        ahead = time[row + 1 : row + 2 + max(n_before, 1)]
        agree = np.flatnonzero(np.abs(ahead - time[row]) <= gap_ns)
        if not len(agree):
            if not is_end and row + 2 + max(n_before, 1) > len(time):
                return is_stray, row + 1
            continue
        n = int(agree[0])
        has_time = n == 1 or abs(time[row] - time[row - n]) <= abs(ahead[n] - time[row])
        is_stray[row + 1 : row + 1 + n] = has_time and (np.abs(ahead[:n] - ahead[n]) > gap_ns).all()
    return is_stray, len(time)


def _last_stretch(time: np.ndarray, gap_ns: int) -> np.ndarray:
    """Return the last stamps that lie within a gap of the very last."""
    n = FIRST_LOOK
    while True:
        tail = time[-n:]
        far = np.flatnonzero(np.abs(tail.astype(np.float64) - float(time[-1] if len(time) else 0)) > gap_ns)
        if len(far) or n >= len(time):
            return tail[far[-1] + 1 :] if len(far) else tail
        n *= 2
