"""Find out what a folder of logs holds."""

from pathlib import Path

from pipeline.errors import InputError
from pipeline.logs.describe.bags import add_bag
from pipeline.logs.describe.contents import Contents
from pipeline.logs.describe.tables import add_table
from pipeline.logs.formats.bags import STORAGE_READERS
from pipeline.logs.formats.discover import find_logs


def describe(directory: Path) -> Contents:
    """Return what the logs of a folder hold. A log that cannot be read does not stop the others.

    Raises:
        InputError: The folder holds no logs, or none that can be read.
    """
    contents = Contents()
    for entry in find_logs(directory):
        try:
            if entry.error:
                raise InputError(entry.error)
            add = add_bag if entry.format in STORAGE_READERS else add_table
            add(entry, contents)
        except InputError as error:
            contents.failures.append(str(error))
    if not contents.streams:
        raise InputError(f"{directory}: nothing can be read: {'; '.join(contents.failures) or 'no messages'}")
    return contents
