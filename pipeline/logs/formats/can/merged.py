"""Join the signals of several frames into rows of one value per joint."""

from collections.abc import Iterable, Iterator

import numpy as np

from pipeline.logs.conditioning.ordering import sort_by_time, split_at_steps_back
from pipeline.logs.conditioning.samples import Samples, join
from pipeline.logs.conditioning.stray_stamps import drop_stray_stamps
from pipeline.logs.messages.message_blocks import MAXIMUM_TIME_NS
from pipeline.logs.messages.raw_log import Note


def merged_rows(
    frames: Iterable[Samples],
    joints: list[list[int]],
    is_held: bool,
    gap_ns: int,
    what: str,
    notes: list[Note],
) -> Iterator[Samples]:
    """Yield rows of all joints from frames that each hold the values of some, within bounded memory.

    Positions are interpolated linearly to the times of frame 0. Commands have a row at every frame, with the last
    values of the others, once each has come. A clock that steps back begins an era, for which earlier frames do not
    count.

    Args:
        frames: Samples in the order of the log: the frame's number, then a value per joint, NaN for those of other
            frames; shape (n, 1 + n_joint).
        joints: Joints of each frame.
        is_held: Whether these are commands.
        gap_ns: Longer pauses of a frame are not interpolated, and longer steps back are steps of the clock.
        what: For the notes.
        notes: Gets what is left out.
    """
    stream = split_at_steps_back(drop_stray_stamps(frames, gap_ns, what, "time", notes), gap_ns)
    stream = sort_by_time(stream, gap_ns, what, "time", notes)
    return _held(stream, joints) if is_held else _interpolated(stream, joints, gap_ns)


def _held(stream: Iterable[Samples], joints: list[list[int]]) -> Iterator[Samples]:
    era, last, has_come = -1, np.zeros(0), np.zeros(len(joints), bool)
    for section in _of_whole_instants(stream):
        if section.era != era:
            era, last, has_come = section.era, np.full(section.value.shape[1] - 1, np.nan), has_come & False
        values, is_known = np.tile(last, (len(section), 1)), np.ones(len(section), bool)
        for number, columns in enumerate(joints):
            own = np.flatnonzero(section.value[:, 0] == number)
            newest = np.searchsorted(own, np.arange(len(section)), side="right") - 1
            after, places = np.flatnonzero(newest >= 0), np.array(columns)
            values[after[:, None], places] = section.value[own[newest[after]]][:, 1 + places]
            is_known &= has_come[number] | (newest >= 0)
            has_come[number] |= len(own) > 0
        is_known[:-1] &= np.diff(section.time_ns) > 0  # of frames at one time, the last row holds all
        last = values[-1] if len(values) else last
        yield Samples(section.time_ns, values, era)[is_known]


def _of_whole_instants(stream: Iterable[Samples]) -> Iterator[Samples]:
    """Divide a sorted stream so that frames of one time stand in one section."""
    waiting: Samples | None = None
    for section in stream:
        if not len(section):
            continue
        if waiting is not None and waiting.era != section.era:
            yield waiting
            waiting = None
        waiting = section if waiting is None else join([waiting, section])
        n_settled = int(np.searchsorted(waiting.time_ns, waiting.time_ns[-1]))
        yield waiting[:n_settled]
        waiting = waiting[n_settled:]
    if waiting is not None:
        yield waiting


def _interpolated(stream: Iterable[Samples], joints: list[list[int]], gap_ns: int) -> Iterator[Samples]:
    waiting: Samples | None = None  # what may still be a neighbour of rows to come
    settled = -1
    for section in stream:
        if waiting is not None and waiting.era != section.era:
            yield _between(waiting, joints, settled, MAXIMUM_TIME_NS, gap_ns)
            waiting, settled = None, -1
        waiting = section if waiting is None else join([waiting, section])
        if len(waiting):
            until = int(waiting.time_ns[-1]) - gap_ns
            yield _between(waiting, joints, settled, until, gap_ns)
            waiting, settled = waiting[waiting.time_ns >= until - gap_ns], until
    if waiting is not None:
        yield _between(waiting, joints, settled, MAXIMUM_TIME_NS, gap_ns)


def _between(frames: Samples, joints: list[list[int]], after_ns: int, until_ns: int, gap_ns: int) -> Samples:
    """The rows at times of frame 0 after `after_ns`, up to `until_ns`."""
    number, times = frames.value[:, 0], frames.time_ns
    at = times[(number == 0) & (times > after_ns) & (times <= until_ns)]
    values = np.full((len(at), frames.value.shape[1] - 1), np.nan)
    for frame, columns in enumerate(joints):
        if not (own := number == frame).any():
            continue
        known, time_ns = frames.value[own][:, 1:], times[own]
        for column in columns:
            elapsed = (at - time_ns[0], time_ns - time_ns[0])
            values[:, column] = np.interp(*elapsed, known[:, column], left=np.nan, right=np.nan)
        following = np.searchsorted(time_ns, at, side="left").clip(max=len(time_ns) - 1)
        before = np.maximum(np.searchsorted(time_ns, at, side="right") - 1, 0)
        values[np.ix_(time_ns[following] - time_ns[before] > gap_ns, columns)] = np.nan
    return Samples(at, values, frames.era)
