"""Visual topics as an MCAP file."""

from collections.abc import Sequence
from pathlib import Path

from mcap.writer import CompressionType, Writer

from pipeline.deployment.viewing.visual_topics import STORE, VisualTopic


def write_visual_file(path: Path, topics: Sequence[VisualTopic]) -> None:
    """Write one MCAP file in the order of time; it appears whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    with partial.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="hydraulic-arm-pipeline")
        rows = []
        for number, topic in enumerate(topics):
            definition, _ = STORE.generate_msgdef(topic.type_name, ros_version=2)
            schema = writer.register_schema(topic.type_name, "ros2msg", definition.encode())
            channel = writer.register_channel(topic.name, "cdr", schema, {"offered_qos_profiles": ""})
            rows += [(time_ns, number, channel, message) for time_ns, message in topic.messages]
        for sequence, (time_ns, number, channel, message) in enumerate(sorted(rows, key=lambda row: row[:2])):
            data = bytes(STORE.serialize_cdr(message, topics[number].type_name))
            writer.add_message(channel, time_ns, data, publish_time=time_ns, sequence=sequence)
        writer.finish()
    partial.replace(path)
