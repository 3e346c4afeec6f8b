"""Condition a recorded log into streams that can be resampled; every dropped or changed sample is counted.

Messages that are stored out of order of their log time are put in order first (`recording_order`).

Rules for joint samples, in this order:
- A sample whose stamp is zero because the clock had not started is dropped.
- Samples with a stray stamp are dropped (`stray_stamps`).
- Samples with a value that is not finite, or too large for a position, are dropped.
- Encoder wrap-around of revolute joints is undone; whole turns are subtracted so that the log starts near the limits.
- Values outside the joint limits are kept and counted: the limits describe the machine, not its encoders.
- A step of the clock back by more than the longest gap splits the log. Smaller steps are reordered messages, which are
  sorted. Of samples with one stamp, the first is kept.
- A spike is dropped: one sample that differs from both neighbours by more than a joint can move, while these agree. A
  lasting jump splits the log.

Rules for commands: a command outside the machine's set is unknown until the next command, so no tuples are made there.
If they are many, the configuration is wrong and the log is refused. As for joint samples, stray stamps are dropped
and commands are sorted. Commands whose log time is zero, because the recorder's clock had not started, count as given
before all others.
"""

from collections.abc import Iterator

from pipeline.errors import InputError
from pipeline.logs.conditioning.channels import held_channels
from pipeline.logs.conditioning.clocks import (
    HEADER_STAMP,
    LOG_TIME,
    choose_clock,
    command_times,
    count_unset,
    offset_warnings,
)
from pipeline.logs.conditioning.command_rules import HeldCommands, keep_first_unset, mark_invalid
from pipeline.logs.conditioning.encoder_rules import (
    count_beyond_limits,
    drop_impossible,
    drop_spikes,
    drop_unset_times,
    split_at_jumps,
    unwrap,
)
from pipeline.logs.conditioning.ordering import (
    drop_repeated_stamps,
    record_intervals,
    sort_by_time,
    split_at_steps_back,
)
from pipeline.logs.conditioning.recording_order import in_order_of_time
from pipeline.logs.conditioning.samples import Samples
from pipeline.logs.conditioning.stray_stamps import drop_stray_stamps
from pipeline.logs.conditioning.units import unit_warnings
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.messages.columns import ColumnStore, sections
from pipeline.logs.messages.raw_log import NANOSECONDS, Note, NoteKind, RawLog
from pipeline.machine.specification import MachineSpecification

JOINT_INTERVALS, COMMAND_INTERVALS = "joint_intervals", "command_intervals"  # tables of the store


class ConditionedLog:
    """A log's two streams, each to be read once and in parallel.

    Attributes:
        clock: Measurements of the log's clocks.
        clocks: Times of both streams that give the log's start and end: log times, unless header stamps time the
            commands.
        notes: Dropped and changed samples; complete once the streams are read and `finish` was called.
        joints: Joint samples in stretches without steps of the clock or jumps of an encoder; times ascend strictly.
        commands: The command in force; NaN where it is unknown.
        channels: The machine's channels.
        lost_channels: Indices of channels that cannot be assigned to samples; known after `finish`.
    """

    def __init__(
        self,
        raw: RawLog,
        machine: MachineSpecification,
        config: IngestConfig,
        store: ColumnStore,
        section_rows: int | None = None,
    ) -> None:
        gap_ns = round(config.maximum_gap_s * NANOSECONDS)
        raw, order_notes = in_order_of_time(raw, gap_ns, store)
        self.raw, self.machine = raw, machine
        command_ns, offset_s = command_times(raw, machine.commands, gap_ns)
        time_ns, self.clock, self.notes = choose_clock(
            raw, config.maximum_gap_s, config.maximum_clock_offset_s, machine.joint_states, offset_s
        )
        self.notes += order_notes
        notes, name = self.notes, self.clock.used
        notes += offset_warnings(raw, self.clock, offset_s, machine)
        self.clocks = (raw.joint_log_time_ns, raw.command_log_time_ns)
        if raw.command_stamp_ns is not None:
            self.clocks = (time_ns, command_ns)
        samples = (Samples(at_ns, q) for at_ns, q in sections((time_ns, raw.q), n_rows=section_rows))
        n_unset = count_unset(time_ns, gap_ns)
        stream: Iterator[Samples] = drop_unset_times(samples, n_unset, "joint samples", name, notes)
        stream = drop_stray_stamps(stream, gap_ns, "joint samples", name, notes)
        stream = unwrap(drop_impossible(stream, machine, notes), machine, notes)
        stream = split_at_steps_back(count_beyond_limits(stream, machine, notes), gap_ns)
        stream = sort_by_time(self._counted(stream), gap_ns, "joint samples", name, notes)
        stream = record_intervals(stream, store, JOINT_INTERVALS)
        stream = drop_repeated_stamps(stream, f"joint samples: their {name}", notes)
        stream = drop_spikes(stream, machine, config, notes)
        self.joints = split_at_jumps(stream, machine, config, notes)
        self.n_eras = 0
        issued: Iterator[Samples] = (
            Samples(at_ns, command)
            for at_ns, command in sections((command_ns, raw.command), n_rows=section_rows)
        )
        by = LOG_TIME if raw.command_stamp_ns is None else HEADER_STAMP
        if n_unset := count_unset(command_ns, gap_ns):
            if n_unset == len(command_ns) > 1:
                other = HEADER_STAMP if by == LOG_TIME else LOG_TIME
                raise InputError(
                    f"{raw.path}: the {by} of all {n_unset} commands is zero; set commands.clock to "
                    f"{other.replace(' ', '_')} in conf/machine/{machine.name}.yaml if they have one"
                )
            issued = keep_first_unset(issued, "commands", by, notes)
        issued = drop_stray_stamps(issued, gap_ns, "commands", by, notes)
        valid = mark_invalid(issued, machine, config.maximum_invalid_command_fraction, raw.path, self.notes)
        ordered = sort_by_time(split_at_steps_back(valid, gap_ns), gap_ns, "commands", by, self.notes)
        self.channels = held_channels(raw, machine, gap_ns, section_rows)
        self.lost_channels: list[int] = []
        self.commands = HeldCommands(record_intervals(ordered, store, COMMAND_INTERVALS))

    def finish(self) -> None:
        """Run the checks that need both streams' ends.

        Raises:
            InputError: No joint sample was left, too many commands are outside the machine's set, or only one of the
                two clocks stepped back, so that commands cannot be assigned to samples.
        """
        self.notes += unit_warnings(self.raw, self.machine)
        n_command_eras = self.commands.finish()
        if self.n_eras == 0:
            reasons = [note.text for note in self.notes if note.text.startswith("joint samples: ")]
            has_values = not any(text.startswith("joint samples: the position") for text in reasons)
            why = "none has a time" if has_values else "none holds a position for all joints"
            raise InputError(
                f"{self.raw.path}: no joint sample is left of {len(self.raw.q)}: {why} ({'; '.join(reasons)})"
            )
        if n_command_eras != self.n_eras:
            raise InputError(
                f"{self.raw.path}: the clock steps back {self.n_eras - 1} times in the joint samples and "
                f"{n_command_eras - 1} times in the commands; split the bag at the steps"
            )
        self.lost_channels = [
            number
            for number, channel in enumerate(self.channels)
            if not channel.finish(self.n_eras, self.notes)
        ]
        if self.n_eras > 1:
            text = "the clock steps back; the log is split there"
            self.notes.append(Note(NoteKind.changed, text, self.n_eras - 1))

    def _counted(self, stream: Iterator[Samples]) -> Iterator[Samples]:
        for section in stream:
            self.n_eras = section.era + 1
            yield section
