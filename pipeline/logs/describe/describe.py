"""Find out what a folder of logs holds."""

from pathlib import Path

from pipeline.errors import InputError
from pipeline.logs.describe.bags import add_bag
from pipeline.logs.describe.can import add_can, database_beside
from pipeline.logs.describe.contents import Contents
from pipeline.logs.describe.lerobot import add_episode
from pipeline.logs.describe.tables import add_table
from pipeline.logs.formats.bags import STORAGE_READERS
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.formats.discovery.log_entry import LogFormat


def describe(directory: Path) -> Contents:
    """Return what the logs of a folder hold. A log that cannot be read does not stop the others.

    Raises:
        InputError: The folder holds no logs, or none that can be read.
    """
    contents = Contents()
    database = database_beside(directory)
    for entry in find_logs(directory):
        try:
            if entry.error:
                raise InputError(entry.error)
            if entry.format in STORAGE_READERS:
                add_bag(entry, contents)
            elif entry.format is LogFormat.can:
                add_can(entry, contents, database)
            elif entry.format is LogFormat.lerobot:
                add_episode(entry, contents)
            else:
                add_table(entry, contents)
        except InputError as error:
            contents.failures.append(str(error))
    if not contents.streams:
        raise InputError(f"{directory}: nothing can be read: {'; '.join(contents.failures) or 'no messages'}")
    return contents
