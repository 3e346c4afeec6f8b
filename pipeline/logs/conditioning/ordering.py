"""Rules for the order of time: steps of the clock, reordered messages, repeated stamps."""

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from pipeline.logs.conditioning.samples import Samples, join
from pipeline.logs.messages.columns import ColumnStore
from pipeline.logs.messages.raw_log import Note, NoteKind


def split_at_steps_back(stream: Iterable[Samples], gap_ns: int) -> Iterator[Samples]:
    """Begin a new era where the clock steps back by more than `gap_ns`."""
    era, last_ns = 0, None
    for section in stream:
        if not len(section):
            continue
        behind = section.time_ns[0] if last_ns is None else last_ns
        steps = np.flatnonzero(np.diff(section.time_ns, prepend=behind) < -gap_ns)
        bounds = [0, *steps.tolist(), len(section)]
        for number, (begin, end) in enumerate(itertools.pairwise(bounds)):
            era += number > 0
            if end > begin:
                yield replace(section[begin:end], era=era)
        last_ns = section.time_ns[-1]


def sort_by_time(
    stream: Iterable[Samples], window_ns: int, what: str, clock_name: str, notes: list[Note]
) -> Iterator[Samples]:
    """Sort the samples of each era by time; equal times keep their order.

    A sample older by more than `window_ns` than an earlier one is dropped, so that the buffer holds one window only.
    """
    n_back = n_late = 0
    held: Samples | None = None
    newest = last_ns = 0
    for section in stream:
        if held is not None and held.era != section.era:
            yield held
            held = None
        if held is None:
            newest = last_ns = int(section.time_ns[0])
        n_back += int((np.diff(section.time_ns, prepend=last_ns) < 0).sum())
        last_ns = int(section.time_ns[-1])
        newest_before = np.maximum.accumulate(np.concatenate([[newest], section.time_ns[:-1]]))
        late = section.time_ns < newest_before - window_ns
        n_late += int(late.sum())
        newest = int(max(newest, section.time_ns.max()))
        pending = section[~late]
        if held is not None:
            pending = join([held, pending])
        order = np.argsort(pending.time_ns, kind="stable")
        n_settled = int(np.searchsorted(pending.time_ns[order], newest - window_ns, side="left"))
        yield pending[order[:n_settled]]
        held = pending[order[n_settled:]]
    if held is not None:
        yield held
    if n_back:
        text = f"{what} out of order by {clock_name}; put in order"
        notes.append(Note(NoteKind.changed, text, n_back, is_usual=True))
    if n_late:
        text = f"{what}: by {clock_name} more than {window_ns / 1e9:g} s older than one before"
        notes.append(Note(NoteKind.left_out, text, n_late))


def drop_repeated_stamps(stream: Iterable[Samples], what: str, notes: list[Note]) -> Iterator[Samples]:
    """Keep only the first sample of each stamp."""
    n_repeated, era, last_ns = 0, -1, 0
    for section in stream:
        if not len(section):
            continue
        first = np.empty(len(section), bool)
        first[0] = section.era != era or section.time_ns[0] > last_ns
        first[1:] = np.diff(section.time_ns) > 0
        n_repeated += int((~first).sum())
        era, last_ns = section.era, int(section.time_ns[-1])
        yield section[first] if not first.all() else section
    if n_repeated:
        notes.append(Note(NoteKind.left_out, f"{what} repeats the one before", n_repeated))


def record_intervals(stream: Iterable[Samples], store: ColumnStore, table: str) -> Iterator[Samples]:
    """Store the intervals between the samples of each era, in ns, for the quality report."""
    era, last_ns = -1, 0
    for section in stream:
        if len(section):
            behind = section.time_ns[:0] if section.era != era else np.array([last_ns])
            store.append(table, {"interval_ns": np.diff(np.concatenate([behind, section.time_ns]))})
            era, last_ns = section.era, int(section.time_ns[-1])
        yield section
