"""Diagnostics as `diagnostic_msgs/DiagnosticArray` of rosbags, for bags and viewers."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from rosbags.typesys.store import Typestore

if TYPE_CHECKING:
    from rosbags.typesys.store import Msg

from pipeline.deployment.component import NANOSECONDS
from pipeline.deployment.messages import Diagnostics, Level, Status

DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"


def diagnostic_array(store: Typestore, message: Diagnostics) -> "Msg":
    """The message as a ROS 2 one."""
    types = store.types
    make_status, pair = types["diagnostic_msgs/msg/DiagnosticStatus"], types["diagnostic_msgs/msg/KeyValue"]
    seconds, nanoseconds = divmod(message.stamp_ns, NANOSECONDS)
    stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    statuses = [
        make_status(
            level=status.level.value,
            name=status.source,
            message=status.text,
            hardware_id="",
            values=[pair(key=key, value=value) for key, value in status.values.items()],
        )
        for status in message.statuses
    ]
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    return types[DIAGNOSTIC_ARRAY](header=header, status=statuses)


def read_diagnostic_array(ros: Any) -> Diagnostics:
    """The message of a ROS 1 or ROS 2 one, of rosbags."""
    stamp = ros.header.stamp
    stamp_ns = int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)
    return Diagnostics(stamp_ns, read_statuses(ros.status))


def read_statuses(ros: Iterable[Any]) -> tuple[Status, ...]:
    """Statuses of `DiagnosticStatus` of any ROS."""
    return tuple(
        Status(s.name, Level(int(s.level)), s.message, {pair.key: pair.value for pair in s.values})
        for s in ros
    )
