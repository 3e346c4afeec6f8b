"""Condition a recorded log into streams that can be resampled; every dropped or changed sample is counted.

Rules for joint samples, in this order:
- A sample whose stamp lies far from both neighbours, while these agree, is dropped (a damaged stamp).
- Samples with a non-finite value are dropped.
- Encoder wrap-around of revolute joints is undone; whole turns are subtracted so that the log starts near the limits.
- Values outside the joint limits are kept and counted: the limits describe the machine, not its encoders.
- A step of the clock back by more than the longest gap splits the log. Smaller steps are reordered messages, which are
  sorted. Of samples with one stamp, the first is kept.
- A spike is dropped: one sample that differs from both neighbours by more than a joint can move, while these agree. A
  lasting jump splits the log.

Rules for commands: a command outside the machine's set is unknown until the next command, so no tuples are made there.
If they are many, the configuration is wrong and the log is refused. As for joint samples, isolated stamps are dropped
and commands are sorted.
"""

from collections.abc import Iterator

from pipeline.errors import InputError
from pipeline.logs.conditioning.clocks import LOG_TIME, choose_clock
from pipeline.logs.conditioning.command_rules import HeldCommands, mark_invalid
from pipeline.logs.conditioning.encoder_rules import (
    count_beyond_limits,
    drop_isolated_stamps,
    drop_non_finite,
    drop_spikes,
    split_at_jumps,
    unwrap,
)
from pipeline.logs.conditioning.ordering import (
    drop_repeated_stamps,
    record_intervals,
    sort_by_time,
    split_at_steps_back,
)
from pipeline.logs.conditioning.samples import Samples
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.messages.columns import ColumnStore, sections
from pipeline.logs.messages.raw_log import NANOSECONDS, Note, NoteKind, RawLog
from pipeline.machine.specification import MachineSpecification

JOINT_INTERVALS, COMMAND_INTERVALS = "joint_intervals", "command_intervals"  # tables of the store


class ConditionedLog:
    """A log's two streams, each to be read once and in parallel.

    Attributes:
        clock: Measurements of the log's clocks.
        notes: Dropped and changed samples; complete once the streams are read and `finish` was called.
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
        stream: Iterator[Samples] = drop_isolated_stamps(samples, gap_ns, "joint samples", name, notes)
        stream = unwrap(drop_non_finite(stream, machine, notes), machine, notes)
        stream = split_at_steps_back(count_beyond_limits(stream, machine, notes), gap_ns)
        stream = sort_by_time(self._counted(stream), gap_ns, "joint samples", name, notes)
        stream = record_intervals(stream, store, JOINT_INTERVALS)
        stream = drop_repeated_stamps(stream, f"joint samples: their {name}", notes)
        stream = drop_spikes(stream, machine, config, notes)
        self.joints = split_at_jumps(stream, machine, config, notes)
        self.n_eras = 0
        issued: Iterator[Samples] = (
            Samples(at_ns, command)
            for at_ns, command in sections((raw.command_log_time_ns, raw.command), n_rows=section_rows)
        )
        issued = drop_isolated_stamps(issued, gap_ns, "commands", LOG_TIME, notes)
        valid = mark_invalid(issued, machine, config.maximum_invalid_command_fraction, raw.path, self.notes)
        ordered = sort_by_time(split_at_steps_back(valid, gap_ns), gap_ns, "commands", LOG_TIME, self.notes)
        self.commands = HeldCommands(record_intervals(ordered, store, COMMAND_INTERVALS))

    def finish(self) -> None:
        """Run the checks that need both streams' ends.

        Raises:
            InputError: No joint sample was left, too many commands are outside the machine's set, or only one of the
                two clocks stepped back, so that commands cannot be assigned to samples.
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
