"""Rules for commands: admissible values, and the command in force at a given time."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.conditioning.samples import Samples, join
from pipeline.logs.messages.raw_log import Note, NoteKind
from pipeline.machine.specification import CommandKind, MachineSpecification

ROUNDING = 1e-6  # a float32 command of full scale may slightly exceed 1


def keep_first_unset(
    stream: Iterable[Samples], what: str, clock_name: str, notes: list[Note]
) -> Iterator[Samples]:
    """Keep samples whose time is zero because the clock had not started where they come first; drop later ones."""
    n_first = n_late = 0
    has_started = False
    for section in stream:
        is_set = section.time_ns != 0
        late = ~is_set & (has_started | np.logical_or.accumulate(is_set))
        has_started |= bool(is_set.any())
        n_late += int(late.sum())
        n_first += int((~is_set & ~late).sum())
        yield section[~late]
    if n_first:
        text = f"{what}: their {clock_name} is zero; taken as given before all others"
        notes.append(Note(NoteKind.changed, text, n_first))
    if n_late:
        notes.append(Note(NoteKind.left_out, f"{what}: their {clock_name} is zero", n_late))


def mark_invalid(
    stream: Iterable[Samples],
    machine: MachineSpecification,
    maximum_fraction: float,
    path: Path,
    notes: list[Note],
) -> Iterator[Samples]:
    """Replace commands with a value outside the machine's set by NaN for all joints.

    Raises:
        InputError: At the stream's end, if their share exceeds `maximum_fraction`.
    """
    discrete = machine.command_kind == CommandKind.discrete
    allowed = "{-1, 0, 1}" if discrete else "[-1, 1]"
    count = n_bad = 0
    example = ""
    for section in stream:
        if discrete:
            bad, value = ~np.isin(section.value, (-1.0, 0.0, 1.0)), section.value
        else:
            bad, value = ~(np.abs(section.value) <= 1.0 + ROUNDING), np.clip(section.value, -1.0, 1.0)
        rows: np.ndarray = np.any(bad, axis=1)
        count += len(rows)
        if rows.any():
            first = int(rows.argmax())
            joint = int(bad[first].argmax())
            example = example or (
                f"{section.value[first, joint]:g} for {machine.joint_names[joint]} "
                f"at log time {section.time_ns[first]} ns"
            )
            n_bad += int(rows.sum())
            value = np.where(rows[:, None], np.nan, value)
        yield replace(section, value=value)
    if n_bad > maximum_fraction * count:
        raise InputError(
            f"{path}: {n_bad} of {count} commands are outside {allowed}, first {example}; "
            f"check commands and command_kind in conf/machine/{machine.name}.yaml"
        )
    if n_bad:
        text = f"commands outside {allowed} (first {example}): unknown, so no tuples until the next command"
        notes.append(Note(NoteKind.left_out, text, n_bad))


class HeldCommands:
    """The command in force at ascending times: the last one at or before each (causal zero-order hold)."""

    def __init__(self, stream: Iterable[Samples]) -> None:
        self.stream = iter(stream)
        self.ahead: Samples | None = None  # read but not in force yet
        self.known: Samples | None = None  # the present era's commands, from the one in force on
        self.era = -1  # era of the joint samples
        self.newest_era = -1  # era of the newest command
        self.era_ended = False
        self.first_ns: int | None = None

    def begin(self, era: int) -> int | None:
        """Advance to an era; return the time of its first command, None for an era without commands."""
        if era != self.era:
            self.era, self.known, self.first_ns, self.era_ended = era, None, None, False
            self._read()
        return self.first_ns

    def at(self, time_ns: np.ndarray) -> np.ndarray:
        """Return the commands in force, shape (n, n_joint); every time must follow the era's first command."""
        while not self.era_ended and self.known is not None and self.known.time_ns[-1] <= time_ns[-1]:
            self._read()
        assert self.known is not None
        in_force = np.searchsorted(self.known.time_ns, time_ns, side="right") - 1
        commands = self.known.value[in_force]
        self.known = self.known[int(in_force[-1]) :]
        return commands

    def finish(self) -> int:
        """Read to the end; return the number of eras."""
        for section in self.stream:
            self.newest_era = section.era
        return self.newest_era + 1

    def _read(self) -> None:
        """Read the next section of the present era."""
        while self.ahead is None or not len(self.ahead) or self.ahead.era < self.era:
            self.ahead = next(self.stream, None)
            if self.ahead is None:
                self.era_ended = True
                return
            self.newest_era = self.ahead.era
        if self.ahead.era > self.era:
            self.era_ended = True
            return
        self.known = self.ahead if self.known is None else join([self.known, self.ahead])
        if self.first_ns is None:
            self.first_ns = int(self.known.time_ns[0])
        self.ahead = None
