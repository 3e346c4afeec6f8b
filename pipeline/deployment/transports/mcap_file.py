"""Messages of ROS 2 types as an MCAP file."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from mcap.writer import CompressionType, Writer
from rosbags.typesys.store import Typestore

if TYPE_CHECKING:
    from rosbags.typesys.store import Msg


class RecordedTopic(NamedTuple):
    """A topic, its ROS 2 type, and its messages with their times, ns."""

    name: str
    type_name: str
    messages: list[tuple[int, "Msg"]]


def write_mcap_file(path: Path, store: Typestore, topics: Sequence[RecordedTopic]) -> None:
    """Write one MCAP file in the order of time; it appears complete or not at all.

    Args:
        path: of the file.
        store: knows the topics' types.
        topics: in the order in which messages of one time are written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    with partial.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="hydraulic-arm-pipeline")
        rows = []
        for number, topic in enumerate(topics):
            definition, _ = store.generate_msgdef(topic.type_name, ros_version=2)
            schema = writer.register_schema(topic.type_name, "ros2msg", definition.encode())
            channel = writer.register_channel(topic.name, "cdr", schema, {"offered_qos_profiles": ""})
            rows += [(time_ns, number, channel, message) for time_ns, message in topic.messages]
        for sequence, (time_ns, number, channel, message) in enumerate(sorted(rows, key=lambda row: row[:2])):
            data = bytes(store.serialize_cdr(message, topics[number].type_name))
            writer.add_message(channel, time_ns, data, publish_time=time_ns, sequence=sequence)
        writer.finish()
    partial.replace(path)
