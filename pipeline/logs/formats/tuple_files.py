"""Tell the tuples of an earlier run from logs."""

from pathlib import Path

import pyarrow
from pyarrow.parquet import read_schema

SUFFIX = ".parquet"


def is_tuple_file(path: Path) -> bool:
    """Whether `pipeline.logs.tuples` wrote the Parquet file, for any machine."""
    try:
        names = read_schema(path).names
    except (OSError, pyarrow.ArrowException):
        return False
    return names[:3] == ["trajectory", "t", "stamp"] and names[-1] == "split"
