"""Messages in JSON, as Foxglove's tools and browsers record them in MCAP files."""

import json
import math
import re
from collections.abc import Collection
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from pipeline.logs.messages.decoding.field_paths import Step
from pipeline.logs.messages.decoding.layout import FieldGroup
from pipeline.logs.messages.decoding.trees import TreeError, decode_trees
from pipeline.logs.messages.message_blocks import MessageBlock

RFC_3339 = re.compile(r"(\d{4}-\d\d-\d\d[Tt ]\d\d:\d\d:\d\d)(?:\.(\d{1,9})\d*)?([Zz]|[+-]\d\d:\d\d)?")
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def decode_json(block: MessageBlock, wanted: Collection[str]) -> tuple[list[FieldGroup], np.ndarray]:
    """Decode the wanted fields; `null` is not a number. The schema is not needed."""
    return decode_trees(block, wanted, parse_json, json_child)


def parse_json(message: bytes) -> Any:
    """Parse one message.

    Raises:
        TreeError: It is not JSON.
    """
    try:
        return json.loads(message)
    except (ValueError, RecursionError) as error:
        raise TreeError(str(error)) from error


def json_child(value: Any, step: Step) -> Any:
    """The value at a step; `null` is not a number, and a text may be a time."""
    if isinstance(value, str) and step in ("seconds", "nanos"):
        return _part_of_time(value, step)
    if not isinstance(value, dict | list):
        return None
    try:
        found = value[step]  # type: ignore[index]
    except (KeyError, IndexError, TypeError):
        return None
    return math.nan if found is None else found


def _part_of_time(text: str, step: Step) -> float | int:
    """Seconds or nanoseconds of a time in RFC 3339, as Protobuf writes time stamps in JSON; NaN for other texts."""
    match = RFC_3339.fullmatch(text.strip())
    try:
        if match is None:
            return math.nan
        if step == "nanos":
            return int((match[2] or "").ljust(9, "0"))
        whole = datetime.fromisoformat(match[1] + (match[3] or "Z"))
        return int((whole - EPOCH) / timedelta(seconds=1))
    except ValueError:
        return math.nan
