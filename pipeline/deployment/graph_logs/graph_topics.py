"""The graph's own topics in a bag, besides those of every log: requests, results, stops, their resets, diagnostics.

A second file of the bag holds them, so that the first one looks like any log. Types are those of the ROS package
`hydraulic_arm`, and `diagnostic_msgs`; a bag recorded on the ROS graph is read in the same way.
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
from pipeline.deployment.graph_logs.diagnostic_arrays import (
    DIAGNOSTIC_ARRAY,
    diagnostic_array,
    read_diagnostic_array,
)
from pipeline.deployment.messages import (
    Diagnostics,
    EmergencyStop,
    GoalOutcome,
    JointCommand,
    ReachResult,
    Release,
    Reset,
    Topic,
)
from pipeline.deployment.transports.mcap_file import RecordedTopic, write_mcap_file
from pipeline.logs.formats.bags import STORAGE_READERS
from pipeline.logs.formats.discovery.log_entry import LogEntry
from pipeline.logs.messages.message_blocks import MessageBlock, ReadingLedger

PACKAGE = "hydraulic_arm"
DEFINITIONS = Path(__file__).parents[1] / f"transports/ros1/{PACKAGE}/msg"
RESULT_DEFINITION = "time stamp\nuint32 goal_id\nstring outcome\nuint32 n_ticks\n"  # on ROS, of an action


class GraphRecord(NamedTuple):
    """The graph's own messages with their recording times, ns, in that order."""

    requests: list[tuple[int, JointCommand]]
    results: list[tuple[int, ReachResult]]
    stops: list[tuple[int, EmergencyStop]]
    releases: Sequence[tuple[int, Release]] = ()
    resets: Sequence[tuple[int, Reset]] = ()
    diagnostics: Sequence[tuple[int, Diagnostics]] = ()


class _Kind(NamedTuple):
    """A topic: its type's name, the conversions from a message to ROS 2 and back, our own type's definition."""

    type_name: str
    ros: Callable[[Typestore, Any], "Msg"]
    read: Callable[[Any], Any]
    definition: str | None = None


def _own(name: str, fields: Callable[[Any], dict[str, Any]], read: Callable[[Any], Any]) -> _Kind:
    """A type of the package, with its fields' values of a message."""
    type_name, path = f"{PACKAGE}/msg/{name}", DEFINITIONS / f"{name}.msg"

    def ros(store: Typestore, message: Any) -> "Msg":
        time_type, values = store.types["builtin_interfaces/msg/Time"], fields(message)
        for key in {"stamp", "observed", "stop"} & values.keys():
            values[key] = time_type(sec=values[key] // NANOSECONDS, nanosec=values[key] % NANOSECONDS)
        return store.types[type_name](**values)

    return _Kind(type_name, ros, read, path.read_text() if path.exists() else RESULT_DEFINITION)


KINDS: Mapping[Topic, _Kind] = {
    Topic.requested_commands: _own(
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
    Topic.result: _own(
        "ReachResult",
        lambda m: {
            "stamp": m.stamp_ns,
            "goal_id": m.goal_id,
            "outcome": m.outcome.value,
            "n_ticks": m.n_ticks,
        },
        lambda r: ReachResult(_ns(r.stamp), r.goal_id, GoalOutcome(r.outcome), r.n_ticks),
    ),
    Topic.emergency_stop: _own(
        "EmergencyStop",
        lambda m: {"stamp": m.stamp_ns, "rule": m.rule, "detail": m.detail},
        lambda r: EmergencyStop(_ns(r.stamp), r.rule, r.detail),
    ),
    Topic.release: _own(
        "Release",
        lambda m: {"stamp": m.stamp_ns, "stop": m.stop_ns},
        lambda r: Release(_ns(r.stamp), _ns(r.stop)),
    ),
    Topic.reset: _own(
        "Reset",
        lambda m: {"stamp": m.stamp_ns, "stop": m.stop_ns},
        lambda r: Reset(_ns(r.stamp), _ns(r.stop)),
    ),
    Topic.diagnostics: _Kind(DIAGNOSTIC_ARRAY, diagnostic_array, read_diagnostic_array),
}
TOPICS = {f"/{topic}": topic for topic in KINDS}


def graph_store(stock: Stores) -> Typestore:
    """The stock types of a ROS, and those of the package."""
    store = get_typestore(stock)
    for kind in KINDS.values():
        if kind.definition is not None:
            store.register(get_types_from_msg(kind.definition, kind.type_name))
    return store


def add_graph_topics(bag: Path, record: GraphRecord) -> None:
    """Add a file with the graph's own topics to a bag that `write_bag` wrote, and name it in the bag's metadata."""
    store = graph_store(Stores.ROS2_HUMBLE)
    file_name = f"{bag.name}_1.mcap"
    by_topic: dict[Topic, Sequence[tuple[int, Any]]] = dict(zip(KINDS, record, strict=True))
    topics = [
        RecordedTopic(
            f"/{topic}",
            KINDS[topic].type_name,
            [(time_ns, KINDS[topic].ros(store, message)) for time_ns, message in said],
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
    if block.topic.type_name != kind.type_name:
        return []
    is_ros1 = block.topic.encoding == "ros1"
    store = graph_store(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    deserialise = store.deserialize_ros1 if is_ros1 else store.deserialize_cdr
    found = []
    for time_ns, start, length in zip(
        block.log_time_ns.tolist(), block.start.tolist(), block.length.tolist(), strict=True
    ):
        data = block.data[start : start + length].tobytes()
        try:
            found.append((time_ns, kind.read(deserialise(data, kind.type_name))))
        except Exception:  # rosbags may raise anything on malformed bytes
            continue
    return found


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
        name = KINDS[topic].type_name
        about = {
            "name": f"/{topic}",
            "type": name,
            "serialization_format": "cdr",
            "offered_qos_profiles": [],
            "type_description_hash": store.hash_rihs01(name),
        }
        bag["topics_with_message_count"].append({"topic_metadata": about, "message_count": n})
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
