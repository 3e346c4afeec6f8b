"""From a log as recorded to streams that can be resampled; every sample left out or changed is counted.

Rules for joint samples, in this order:
- A sample whose stamp alone lies far from both neighbours' is left out (a damaged stamp).
- Samples with a value that is not a number are left out.
- Encoder wrap-around of revolute joints is undone; whole turns are taken off so that the log's beginning lies about
  the limits.
- Values outside the joint limits are kept and counted: the limits describe the machine, not its encoders.
- A step of the clock back by more than the longest gap splits the log; smaller ones are reordered messages, which are
  put in order. Of samples with one stamp the first counts.
- A spike (one sample away from both neighbours by more than any joint can move, while those agree) is left out; a
  lasting jump splits the log there.

Rules for commands: those outside the machine's set are unknown from their time to the next command, so that no tuples
are made there; if they are many, the configuration is wrong and the log is refused. Stray times are left out, and
commands are put in order, as joint samples are.
"""

from collections.abc import Iterator

from pipeline.errors import InputError
from pipeline.logs.conditioning.clocks import LOG_TIME, choose_clock
from pipeline.logs.conditioning.command_rules import HeldCommands, only_possible
from pipeline.logs.conditioning.encoder_rules import (
    only_numbers,
    split_at_jumps,
    unwrapped,
    within_limits_or_noted,
    without_spikes,
    without_strays,
)
from pipeline.logs.conditioning.ordering import in_order, measured, split_at_steps_back, without_repeats
from pipeline.logs.conditioning.samples import Samples
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.messages.columns import ColumnStore, sections
from pipeline.logs.messages.raw_log import NANOSECONDS, Note, NoteKind, RawLog
from pipeline.machine.specification import MachineSpecification

JOINT_INTERVALS, COMMAND_INTERVALS = "joint_intervals", "command_intervals"  # tables of the store


class ConditionedLog:
    """A log's two streams, to be read once, side by side.

    Attributes:
        clock: What was measured about the log's clocks.
        notes: What was left out or changed; complete once the streams are read and `finish` was called.
        joints: Joint samples in stretches without steps of the clock or jumps of an encoder; times ascend strictly.
        commands: The command in force; NaN where it is unknown.
    """

    def __init__(
        self,
        raw: RawLog,
        machine: MachineSpecification,
        config: IngestConfig,
        store: ColumnStore,
        section_rows: int | None = None,
    ) -> None:
        self.raw = raw
        time_ns, self.clock, self.notes = choose_clock(
            raw, config.maximum_gap_s, config.maximum_clock_offset_s
        )
        gap_ns = round(config.maximum_gap_s * NANOSECONDS)
        notes, name = self.notes, self.clock.used
        samples = (Samples(at_ns, q) for at_ns, q in sections((time_ns, raw.q), n_rows=section_rows))
        stream: Iterator[Samples] = without_strays(samples, gap_ns, "joint samples", name, notes)
        stream = unwrapped(only_numbers(stream, machine, notes), machine, notes)
        stream = split_at_steps_back(within_limits_or_noted(stream, machine, notes), gap_ns)
        stream = in_order(self._counted(stream), gap_ns, "joint samples", name, notes)
        stream = measured(stream, store, JOINT_INTERVALS)
        stream = without_repeats(stream, f"joint samples: their {name}", notes)
        stream = without_spikes(stream, machine, config, notes)
        self.joints = split_at_jumps(stream, machine, config, notes)
        self.n_eras = 0
        issued: Iterator[Samples] = (
            Samples(at_ns, command)
            for at_ns, command in sections((raw.command_log_time_ns, raw.command), n_rows=section_rows)
        )
        issued = without_strays(issued, gap_ns, "commands", LOG_TIME, notes)
        possible = only_possible(
            issued, machine, config.maximum_invalid_command_fraction, raw.path, self.notes
        )
        ordered = in_order(split_at_steps_back(possible, gap_ns), gap_ns, "commands", LOG_TIME, self.notes)
        self.commands = HeldCommands(measured(ordered, store, COMMAND_INTERVALS))

    def finish(self) -> None:
        """Check what can be told at the streams' ends only.

        Raises:
            InputError: No joint sample was left, too many commands are outside the machine's set, or one clock stepped
                back and the other did not: which commands act when cannot be told then.
        """
        n_command_eras = self.commands.finish()
        if self.n_eras == 0:
            raise InputError(
                f"{self.raw.path}: no joint sample is left of {len(self.raw.q)}: none holds numbers for all joints"
            )
        if n_command_eras != self.n_eras:
            raise InputError(
                f"{self.raw.path}: the clock steps back {self.n_eras - 1} times in the joint samples and "
                f"{n_command_eras - 1} times in the commands; split the bag at the steps"
            )
        if self.n_eras > 1:
            text = "the clock steps back; the log is split there"
            self.notes.append(Note(NoteKind.changed, text, self.n_eras - 1))

    def _counted(self, stream: Iterator[Samples]) -> Iterator[Samples]:
        for section in stream:
            self.n_eras = section.era + 1
            yield section
