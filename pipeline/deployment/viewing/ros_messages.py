"""Messages of standard ROS 2 types from arrays, as viewers want them."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from pipeline.deployment.component import NANOSECONDS
from pipeline.deployment.components.recording import BASE_FRAME

STORE = get_typestore(Stores.ROS2_HUMBLE)
UINT32, FLOAT32 = 6, 7  # of sensor_msgs/PointField
FIELD_BYTES = 4


def typed(name: str) -> Callable[..., Any]:
    """The class of a message type."""
    return STORE.types[name]


def stamp(time_ns: int) -> Any:
    """A time, ns since 1970."""
    return typed("builtin_interfaces/msg/Time")(sec=time_ns // NANOSECONDS, nanosec=time_ns % NANOSECONDS)


def header(time_ns: int, frame: str = BASE_FRAME) -> Any:
    """Time and frame."""
    return typed("std_msgs/msg/Header")(stamp=stamp(time_ns), frame_id=frame)


def text_message(text: str) -> Any:
    """A text by itself."""
    return typed("std_msgs/msg/String")(data=text)


def number_message(number: float) -> Any:
    """A number by itself."""
    return typed("std_msgs/msg/Float64")(data=number)


def vector(kind: str, values: np.ndarray) -> Any:
    """A `Point` or `Vector3`, of (3,) values."""
    x, y, z = map(float, values)
    return typed(f"geometry_msgs/msg/{kind}")(x=x, y=y, z=z)


def quaternion_message(values: np.ndarray) -> Any:
    """An orientation (w, x, y, z)."""
    w, x, y, z = map(float, values)
    return typed("geometry_msgs/msg/Quaternion")(w=w, x=x, y=y, z=z)


def cloud(points: np.ndarray, time_ns: int, others: Mapping[str, np.ndarray] | None = None) -> Any:
    """A point cloud in {B}.

    Args:
        points: m, (n, 3).
        time_ns: of the message.
        others: further fields by name, (n,) each, as uint32 where they are integers and as float32 otherwise.
    """
    fields = {**dict(zip("xyz", points.T, strict=True)), **(others or {})}
    kinds = [UINT32 if values.dtype.kind == "u" else FLOAT32 for values in fields.values()]
    columns = [
        np.ascontiguousarray(values, "<u4" if kind == UINT32 else "<f4").view("<u4")
        for values, kind in zip(fields.values(), kinds, strict=True)
    ]
    field, step = typed("sensor_msgs/msg/PointField"), FIELD_BYTES * len(fields)
    return typed("sensor_msgs/msg/PointCloud2")(
        header=header(time_ns),
        height=1,
        width=len(points),
        fields=[
            field(name=name, offset=FIELD_BYTES * i, datatype=kind, count=1)
            for i, (name, kind) in enumerate(zip(fields, kinds, strict=True))
        ],
        is_bigendian=False,
        point_step=step,
        row_step=step * len(points),
        data=np.stack(columns, axis=1).reshape(-1).view(np.uint8),
        is_dense=True,
    )
