"""Messages in JSON, as Foxglove's tools and browsers record them in MCAP files."""

import json
import math
from collections.abc import Collection
from typing import Any

import numpy as np

from pipeline.logs.messages.field_paths import Step
from pipeline.logs.messages.message_blocks import MessageBlock
from pipeline.logs.messages.message_layout import FieldGroup
from pipeline.logs.messages.message_trees import TreeError, decode_trees


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
    """The value at a step; `null` is not a number."""
    if not isinstance(value, dict | list):
        return None
    try:
        found = value[step]  # type: ignore[index]
    except (KeyError, IndexError, TypeError):
        return None
    return math.nan if found is None else found
