"""The graph's own topics in a bag, besides those of every log: requests of the servers, results, stops and releases.

A second file of the bag holds them, so that the first one looks like any log. Types are those of the ROS package
`hydraulic_arm`; a bag recorded on the ROS graph is read in the same way.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import yaml
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

if TYPE_CHECKING:
    from rosbags.typesys.store import Msg

from pipeline.deployment.component import NANOSECONDS
from pipeline.deployment.messages import EmergencyStop, GoalOutcome, JointCommand, ReachResult, Release, Topic
from pipeline.deployment.transports.mcap_file import RecordedTopic, write_mcap_file
from pipeline.logs.formats.bags import STORAGE_READERS
from pipeline.logs.formats.log_entry import LogEntry
from pipeline.logs.messages.message_blocks import MessageBlock, ReadingLedger

PACKAGE = "hydraulic_arm"
DEFINITIONS = Path(__file__).parent / f"transports/ros1/{PACKAGE}/msg"
RESULT_DEFINITION = "time stamp\nuint32 goal_id\nstring outcome\nuint32 n_ticks\n"  # on ROS, of an action


class GraphRecord(NamedTuple):
    """The graph's own messages with their recording times, ns, in that order."""

    requests: list[tuple[int, JointCommand]]
    results: list[tuple[int, ReachResult]]
    stops: list[tuple[int, EmergencyStop]]
    releases: Sequence[tuple[int, Release]] = ()


class _Kind(NamedTuple):
    """A topic: its type's name, and the conversions from a message to its fields' values and back."""

    type_name: str
    fields: Callable[[Any], dict[str, Any]]
    read: Callable[[Any], Any]


KINDS: Mapping[Topic, _Kind] = {
    Topic.requested_commands: _Kind(
        "JointCommand",
        lambda m: {
            "stamp": m.stamp_ns,
            "source": m.source,
            "sequence": m.sequence,
            "observed": m.observed_ns,
            "values": m.values.astype("float32"),
            "is_last": m.is_last,
        },
        lambda r: JointCommand(_ns(r.stamp), r.source, r.sequence, _ns(r.observed), r.values, r.is_last),
    ),
    Topic.result: _Kind(
        "ReachResult",
        lambda m: {
            "stamp": m.stamp_ns,
            "goal_id": m.goal_id,
            "outcome": m.outcome.value,
            "n_ticks": m.n_ticks,
        },
        lambda r: ReachResult(_ns(r.stamp), r.goal_id, GoalOutcome(r.outcome), r.n_ticks),
    ),
    Topic.emergency_stop: _Kind(
        "EmergencyStop",
        lambda m: {"stamp": m.stamp_ns, "rule": m.rule, "detail": m.detail},
        lambda r: EmergencyStop(_ns(r.stamp), r.rule, r.detail),
    ),
    Topic.release: _Kind(
        "Release",
        lambda m: {"stamp": m.stamp_ns, "stop": m.stop_ns},
        lambda r: Release(_ns(r.stamp), _ns(r.stop)),
    ),
}
TOPICS = {f"/{topic}": topic for topic in KINDS}


def add_graph_topics(bag: Path, record: GraphRecord) -> None:
    """Add a file with the graph's own topics to a bag that `write_bag` wrote, and name it in the bag's metadata."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    for kind in KINDS.values():
        store.register(get_types_from_msg(_definition(kind), _full_name(kind)))
    file_name = f"{bag.name}_1.mcap"
    by_topic: dict[Topic, Sequence[tuple[int, Any]]] = dict(zip(KINDS, record, strict=True))
    topics = [
        RecordedTopic(
            f"/{topic}",
            _full_name(KINDS[topic]),
            [(time_ns, _ros(store, topic, message)) for time_ns, message in said],
        )
        for topic, said in by_topic.items()
    ]
    write_mcap_file(bag / file_name, store, topics)
    _name_in_metadata(bag / "metadata.yaml", file_name, store, {t: len(said) for t, said in by_topic.items()})


def read_graph_topics(entry: LogEntry) -> GraphRecord:
    """The graph's own topics in a bag of any format; damaged messages and other types are skipped."""
    said: dict[Topic, list[tuple[int, Any]]] = {topic: [] for topic in KINDS}
    reader = STORAGE_READERS.get(entry.format)
    for path in entry.files if reader is not None else ():
        assert reader is not None
        for block in reader(path, ReadingLedger(entry.path), set(TOPICS)):
            said[TOPICS[block.topic.name]] += _messages(block)
    return GraphRecord(*(sorted(said[topic], key=lambda entry: entry[0]) for topic in KINDS))


def _messages(block: MessageBlock) -> list[tuple[int, Any]]:
    kind = KINDS[TOPICS[block.topic.name]]
    if block.topic.type_name != _full_name(kind):
        return []
    is_ros1 = block.topic.encoding == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(_definition(kind), _full_name(kind)))
    deserialise = store.deserialize_ros1 if is_ros1 else store.deserialize_cdr
    found = []
    for time_ns, start, length in zip(
        block.log_time_ns.tolist(), block.start.tolist(), block.length.tolist(), strict=True
    ):
        data = block.data[start : start + length].tobytes()
        try:
            found.append((time_ns, kind.read(deserialise(data, _full_name(kind)))))
        except Exception:  # rosbags may raise anything on malformed bytes
            continue
    return found


def _ros(store: Typestore, topic: Topic, message: Any) -> "Msg":
    kind = KINDS[topic]
    time_type = store.types["builtin_interfaces/msg/Time"]
    fields = kind.fields(message)
    for name in {"stamp", "observed", "stop"} & fields.keys():
        fields[name] = time_type(sec=fields[name] // NANOSECONDS, nanosec=fields[name] % NANOSECONDS)
    return store.types[_full_name(kind)](**fields)


def _definition(kind: _Kind) -> str:
    path = DEFINITIONS / f"{kind.type_name}.msg"
    return path.read_text() if path.exists() else RESULT_DEFINITION


def _full_name(kind: _Kind) -> str:
    return f"{PACKAGE}/msg/{kind.type_name}"


def _ns(time: Any) -> int:
    return int(time.sec) * NANOSECONDS + int(time.nanosec)


def _name_in_metadata(path: Path, file_name: str, store: Typestore, counts: Mapping[Topic, int]) -> None:
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    bag = content["rosbag2_bagfile_information"]
    n_messages = sum(counts.values())
    bag["relative_file_paths"].append(file_name)
    bag["message_count"] += n_messages
    bag["files"].append({**bag["files"][0], "path": file_name, "message_count": n_messages})
    for topic, n in counts.items():
        name = _full_name(KINDS[topic])
        about = {
            "name": f"/{topic}",
            "type": name,
            "serialization_format": "cdr",
            "offered_qos_profiles": [],
            "type_description_hash": store.hash_rihs01(name),
        }
        bag["topics_with_message_count"].append({"topic_metadata": about, "message_count": n})
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
