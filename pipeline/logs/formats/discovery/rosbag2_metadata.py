"""Read the `metadata.yaml` of a ROS 2 bag; the file may be damaged, hostile, or belong to something else."""

from dataclasses import dataclass
from pathlib import Path

import yaml

METADATA = "metadata.yaml"
KEY = "rosbag2_bagfile_information"
MAXIMUM_CHARACTERS = 1 << 22
MAXIMUM_DEPTH = 64  # rosbag2 nests six levels; the C loader crashes at some ten thousand
MAXIMUM_DIGITS = 18
# The base loader keeps scalars as text and shares what aliases refer to. The C loader is ten times faster.
YamlLoader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)


@dataclass(frozen=True)
class BagMetadata:
    """What the metadata says of a bag.

    Attributes:
        files: Names of the bag's files, in the order of recording; empty if the metadata is damaged.
        compression: Compression of its files or messages, such as `zstd`; empty if there is none.
        message_count: Number of messages in all files, if stated.
    """

    files: tuple[str, ...] = ()
    compression: str = ""
    message_count: int | None = None


def read_metadata(path: Path) -> BagMetadata | None:
    """Read the metadata; None if the file does not belong to a ROS 2 bag.

    An empty file counts as damaged metadata: a crash leaves it.

    Raises:
        OSError: The file cannot be read.
    """
    with path.open(encoding="utf-8", errors="replace") as file:
        text = file.read(MAXIMUM_CHARACTERS)
    try:
        information = _load(text)[KEY]
        files = [name for name in information["relative_file_paths"] if isinstance(name, str)]
        is_compressed = (information.get("compression_mode") or "none").lower() != "none"
        compression = information.get("compression_format") or ""
        stated = information.get("message_count")
        count = int(stated) if isinstance(stated, str) and stated[:MAXIMUM_DIGITS].isdecimal() else None
    except (yaml.YAMLError, ValueError, KeyError, TypeError, AttributeError):
        return BagMetadata() if KEY in text or not text.strip("\0 \r\n") else None
    return BagMetadata(tuple(dict.fromkeys(files)), str(compression) if is_compressed else "", count)


def _load(text: str) -> dict:
    """Parse YAML.

    Raises:
        yaml.YAMLError: It is not YAML.
        ValueError: It is nested too deeply.
    """
    depth = 0
    for event in yaml.parse(text, Loader=YamlLoader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > MAXIMUM_DEPTH:
            raise ValueError(f"nested deeper than {MAXIMUM_DEPTH}")
    loaded: dict = yaml.load(text, Loader=YamlLoader)
    return loaded
