"""MCAP files with JSON and Protobuf messages, as Foxglove's tools write them."""

import json
from pathlib import Path

from google.protobuf import timestamp_pb2
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.writer import CompressionType, Writer

from tests.logs.conftest import Session

DOUBLE, SINT32 = FieldDescriptorProto.TYPE_DOUBLE, FieldDescriptorProto.TYPE_SINT32
STRING, MESSAGE = FieldDescriptorProto.TYPE_STRING, FieldDescriptorProto.TYPE_MESSAGE
TYPES = {
    "json": ("foxglove.JointStates", "std_msgs/msg/Int8MultiArray"),
    "protobuf": ("foxglove.JointStates", "std_msgs.Int8MultiArray"),
}
KINDS = tuple(TYPES)


def add_field(message, number, name, kind, type_name="", repeated=False, optional=False) -> None:
    label = FieldDescriptorProto.LABEL_REPEATED if repeated else FieldDescriptorProto.LABEL_OPTIONAL
    field = message.field.add(name=name, number=number, type=kind, label=label, type_name=type_name or None)
    if optional:
        field.proto3_optional, field.oneof_index = True, len(message.oneof_decl)
        message.oneof_decl.add(name=f"_{name}")


def schema_files() -> FileDescriptorSet:
    """`foxglove.JointStates` and an array of commands; the file that is imported stands last."""
    file = FileDescriptorProto(name="arm.proto", package="foxglove", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    joint = file.message_type.add(name="JointState")
    add_field(joint, 1, "name", STRING)
    add_field(joint, 2, "position", DOUBLE, optional=True)
    states = file.message_type.add(name="JointStates")
    add_field(states, 1, "timestamp", MESSAGE, ".google.protobuf.Timestamp")
    add_field(states, 2, "joints", MESSAGE, ".foxglove.JointState", repeated=True)
    arrays = FileDescriptorProto(name="array.proto", package="std_msgs", syntax="proto3")
    add_field(arrays.message_type.add(name="Int8MultiArray"), 1, "data", SINT32, repeated=True)
    timestamp = FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(timestamp)
    return FileDescriptorSet(file=[file, arrays, timestamp])


def classes() -> tuple[type, type]:
    pool = DescriptorPool()
    for file in reversed(schema_files().file):
        pool.Add(file)
    return tuple(GetMessageClass(pool.FindMessageTypeByName(name)) for name in TYPES["protobuf"])


def joint_states(kind: str, stamp_ns: int, names, q) -> bytes:
    seconds, nanoseconds = divmod(int(stamp_ns), 10**9)
    if kind == "json":
        joints = [{"name": name, "position": float(x)} for name, x in zip(names, q, strict=True)]
        return json.dumps({"timestamp": {"sec": seconds, "nsec": nanoseconds}, "joints": joints}).encode()
    message = classes_of_a_process[0]()
    message.timestamp.seconds, message.timestamp.nanos = seconds, nanoseconds
    for name, x in zip(names, q, strict=True):
        message.joints.add(name=name, position=float(x))
    return message.SerializeToString()


def command(kind: str, values) -> bytes:
    whole = [int(value) for value in values]
    if kind == "json":
        return json.dumps({"data": whole}).encode()
    return classes_of_a_process[1](data=whole).SerializeToString()


classes_of_a_process = classes()


def write(
    path: Path, kind: str, session: Session, names, compression: str = "zstd", enable_crcs: bool = True
) -> Path:
    schema = (
        ("jsonschema", json.dumps({"type": "object"}).encode())
        if kind == "json"
        else ("protobuf", schema_files().SerializeToString())
    )
    entries = [
        (int(t), 0, joint_states(kind, s, names, q))
        for t, s, q in zip(session.log_time_ns, session.stamp_ns, session.q, strict=True)
    ]
    entries += [
        (int(t), 1, command(kind, a)) for t, a in zip(session.command_ns, session.command, strict=True)
    ]
    with path.open("wb") as stream:
        compressions = {"none": CompressionType.NONE, "zstd": CompressionType.ZSTD}
        writer = Writer(
            stream, chunk_size=1 << 14, compression=compressions[compression], enable_crcs=enable_crcs
        )
        writer.start(library="test")
        channels = [
            writer.register_channel(topic, kind, writer.register_schema(name, *schema))
            for topic, name in zip(("/joint_states", "/joint_commands"), TYPES[kind], strict=True)
        ]
        for time_ns, channel, message in sorted(entries, key=lambda entry: entry[0]):
            writer.add_message(channels[channel], time_ns, message, publish_time=time_ns)
        writer.finish()
    return path
