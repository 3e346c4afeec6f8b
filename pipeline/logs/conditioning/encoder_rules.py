"""Rules for joint samples: impossible stamps and values, wrap-around, spikes, jumps, limits."""

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from pipeline.logs.conditioning.samples import Samples, join, with_neighbours
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.messages.raw_log import NANOSECONDS, Note, NoteKind
from pipeline.machine.specification import JointKind, MachineSpecification

TURN = 2 * np.pi
LARGEST_POSITION = 1e6  # rad or m; no joint of a machine gets there
SAMPLES_FOR_TURNS = 4096  # whole turns are judged by the median of these first samples


def drop_unset_times(
    stream: Iterable[Samples], n_unset: int, what: str, clock_name: str, notes: list[Note]
) -> Iterator[Samples]:
    """Drop samples whose time is zero because the clock had not started; `n_unset` is their number."""
    if n_unset:
        notes.append(Note(NoteKind.left_out, f"{what}: their {clock_name} is zero", n_unset))
    for section in stream:
        yield section[section.time_ns != 0] if n_unset else section


def drop_impossible(
    stream: Iterable[Samples], machine: MachineSpecification, notes: list[Note]
) -> Iterator[Samples]:
    """Drop samples with a value that is not finite, or larger than any position."""
    n_strange, n_large = np.zeros((2, machine.n_joint), np.int64)
    for section in stream:
        possible = np.abs(section.value) <= LARGEST_POSITION
        if possible.all():
            yield section
            continue
        finite = np.isfinite(section.value)
        n_strange += np.count_nonzero(~finite, axis=0)
        n_large += np.count_nonzero(finite & ~possible, axis=0)
        yield section[possible.all(axis=1)]
    for number, (joint, unit) in enumerate(zip(machine.joint_names, machine.units, strict=True)):
        for counts, what in ((n_strange, "not a number"), (n_large, f"beyond {LARGEST_POSITION:g} {unit}")):
            if count := int(counts[number]):
                text = f"joint samples: the position of {joint} is {what}"
                notes.append(Note(NoteKind.left_out, text, count))


def unwrap(stream: Iterable[Samples], machine: MachineSpecification, notes: list[Note]) -> Iterator[Samples]:
    """Undo wrap-around of revolute joints, and subtract the whole turns at the log's start."""
    revolute = np.array([JointKind(joint.kind) is JointKind.revolute for joint in machine.joints])
    n_wraps = np.zeros(machine.n_joint, np.int64)
    turns = np.zeros(machine.n_joint, np.int64)  # wraps counted so far
    last: np.ndarray | None = None
    offset: np.ndarray | None = None  # whole turns at the log's start
    held: list[Samples] = []
    for section in stream:
        if not len(section):
            continue
        steps = np.diff(section.value, axis=0, prepend=section.value[:1] if last is None else last[None])
        wound = -np.round(steps / TURN).astype(np.int64) * (np.abs(steps) > np.pi) * revolute
        last = section.value[-1]
        if wound.any():
            n_wraps += np.count_nonzero(wound, axis=0)
            wound_up = turns + np.cumsum(wound, axis=0)
            section = replace(section, value=section.value + TURN * wound_up)
            turns = wound_up[-1]
        elif turns.any():
            section = replace(section, value=section.value + TURN * turns)
        if offset is not None:
            yield _turned(section, offset)
            continue
        held.append(section)
        if sum(len(part) for part in held) >= SAMPLES_FOR_TURNS:
            offset = _whole_turns(held, machine, revolute)
            yield from (_turned(part, offset) for part in held)
    if offset is None and held:
        offset = _whole_turns(held, machine, revolute)
        yield from (_turned(part, offset) for part in held)
    for number, joint in enumerate(machine.joint_names):
        whole = 0 if offset is None else int(offset[number])
        if n_wraps[number] or whole:
            text = f"encoder of {joint} unwrapped: {n_wraps[number]} wraps, {whole} whole turns taken off"
            notes.append(Note(NoteKind.changed, text, max(int(n_wraps[number]), 1), is_usual=True))


def count_beyond_limits(
    stream: Iterable[Samples], machine: MachineSpecification, notes: list[Note]
) -> Iterator[Samples]:
    """Count values outside the joint limits, and keep them."""
    counts = np.zeros(machine.n_joint, np.int64)
    furthest = np.zeros(machine.n_joint)
    for section in stream:
        if len(section):
            beyond = np.maximum(machine.lower - section.value, section.value - machine.upper)
            furthest = np.maximum(furthest, beyond.max(axis=0))
            counts += np.count_nonzero(beyond > 0, axis=0)
        yield section
    for number, (joint, unit) in enumerate(zip(machine.joint_names, machine.units, strict=True)):
        if counts[number]:
            far = f"by up to {furthest[number]:.2g} {unit}"
            text = f"joint samples kept although {joint} is outside its limits, {far}"
            notes.append(Note(NoteKind.attention, text, int(counts[number])))


def drop_spikes(
    stream: Iterable[Samples], machine: MachineSpecification, config: IngestConfig, notes: list[Note]
) -> Iterator[Samples]:
    """Drop samples that differ from both neighbours by more than a joint can move, while these agree."""
    counts = np.zeros(machine.n_joint, np.int64)
    for widened, begin, end in with_neighbours(stream):
        section = widened[begin:end]
        jump = jumps(widened, machine, config)
        if not jump.any():
            yield section
            continue
        spike = np.zeros(widened.value.shape, dtype=bool)
        way = np.abs(widened.value[2:] - widened.value[:-2])
        agree = way <= _reach(widened.time_ns[2:] - widened.time_ns[:-2], machine, config)
        spike[1:-1] = jump[:-1] & jump[1:] & agree
        spike = spike[begin:end]
        counts += spike.sum(axis=0)
        spiky: np.ndarray = np.any(spike, axis=1)
        yield section[~spiky]
    for joint, count in zip(machine.joint_names, counts.tolist(), strict=True):
        if count:
            text = f"joint samples: the position of {joint} is a spike"
            notes.append(Note(NoteKind.left_out, text, count))


def split_at_jumps(
    stream: Iterable[Samples], machine: MachineSpecification, config: IngestConfig, notes: list[Note]
) -> Iterator[Samples]:
    """Begin a new stretch where an encoder jumps further than a joint can move, and with every new era."""
    count, stretch = 0, 0
    last: Samples | None = None
    for section in stream:
        if not len(section):
            continue
        if last is not None and last.era != section.era:
            stretch, last = stretch + 1, None
        joined = section if last is None else join([last, section])
        starts = np.flatnonzero(jumps(joined, machine, config).any(axis=1)) + 1 - (last is not None)
        bounds = [0, *starts.tolist(), len(section)]
        for number, (begin, end) in enumerate(itertools.pairwise(bounds)):
            stretch += number > 0
            if end > begin:
                yield replace(section[begin:end], stretch=stretch)
        count += len(starts)
        last = section[-1:]
    if count:
        text = "encoder jumps beyond any joint's speed; the log is split there"
        notes.append(Note(NoteKind.changed, text, count))


def jumps(samples: Samples, machine: MachineSpecification, config: IngestConfig) -> np.ndarray:
    """Return between which samples a joint moves further than it can, shape (n - 1, n_joint), bool."""
    way = np.abs(np.diff(samples.value, axis=0))
    return way > _reach(np.diff(samples.time_ns), machine, config)


def _reach(interval_ns: np.ndarray, machine: MachineSpecification, config: IngestConfig) -> np.ndarray:
    """Largest motion of each joint in given intervals, shape (n, n_joint); at least that of a control period."""
    interval_s = np.maximum(interval_ns / NANOSECONDS, machine.dt_s)
    return config.maximum_speed_ranges_per_s * interval_s[:, None] * (machine.upper - machine.lower)


def _whole_turns(held: list[Samples], machine: MachineSpecification, revolute: np.ndarray) -> np.ndarray:
    first = join(held)[:SAMPLES_FOR_TURNS].value
    middle = 0.5 * (machine.lower + machine.upper)
    return np.where(revolute, np.round((np.median(first, axis=0) - middle) / TURN), 0).astype(np.int64)


def _turned(section: Samples, offset: np.ndarray) -> Samples:
    return replace(section, value=section.value - TURN * offset) if offset.any() else section
