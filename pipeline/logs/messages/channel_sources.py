"""Channels: whatever else a machine records, one number per message (contract, section 1)."""

from pipeline.errors import InputError
from pipeline.logs.messages.adapters import Converted, FieldColumn, Stamped
from pipeline.logs.messages.columns import ColumnStore
from pipeline.logs.messages.message_blocks import ReadingLedger
from pipeline.logs.messages.raw_log import ChannelSamples, Note, NoteKind
from pipeline.logs.messages.topic_columns import Adapter, TopicColumns
from pipeline.machine.log_sources import ChannelSource, ClockChoice
from pipeline.machine.specification import MachineSpecification


def channel_adapter(channel: ChannelSource) -> Adapter:
    """A field of any message → column `value` (n,), and `stamp_ns` (n,) if header stamps time the channel."""
    field = FieldColumn(f"channel {channel.name}", "value", [channel.field])
    adapter = Converted(field, "value", lambda value: value[:, 0])
    return Stamped(adapter) if channel.clock == ClockChoice.header_stamp else adapter


def channel_collectors(machine: MachineSpecification, store: ColumnStore) -> dict[str, TopicColumns]:
    """Return a collector for each channel that has a topic, by the channel's name."""
    return {
        channel.name: TopicColumns(channel.topic, channel_adapter(channel), store)
        for channel in machine.channels
        if channel.topic
    }


def finish_channels(collectors: dict[str, TopicColumns], ledger: ReadingLedger) -> dict[str, ChannelSamples]:
    """Return the samples of the channels that the log has; what makes one unusable is noted."""
    found = {}
    for name, collector in collectors.items():
        if not ledger.counts.get(collector.topic_name):
            continue
        try:
            columns = collector.finish(ledger)
        except InputError as error:
            reason = str(error).removeprefix(f"{ledger.path}: ")
            ledger.notes.append(Note(NoteKind.left_out, reason, ledger.counts[collector.topic_name]))
            continue
        found[name] = ChannelSamples(columns.get("stamp_ns", columns["log_time_ns"]), columns["value"])
    return found
