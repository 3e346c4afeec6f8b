"""Open SQLite files of unknown content: what a statement costs is bounded by the file's size."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager

# Of SQLite's virtual machine. A row takes 16 bytes or more, and some 30 instructions; the schema takes the others.
INSTRUCTIONS_PER_BYTE, INSTRUCTIONS_OF_ANY = 4, 10_000_000
BETWEEN_CHECKS = 100_000
PLAIN_TABLES = """
    SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0 AND NOT EXISTS (
        SELECT 1 FROM pragma_table_xinfo(sqlite_master.name) AS own WHERE own.hidden OR lower(own.name) = 'rowid')"""


@contextmanager
def read_only(address: str, file_bytes: int, maximum_value_bytes: int) -> Iterator[sqlite3.Connection]:
    """Open a database by its URI; statements that take too long for its size end in `sqlite3.Error`.

    Args:
        address: Its URI.
        file_bytes: Its size.
        maximum_value_bytes: Longer values end a statement, too.
    """
    left = (INSTRUCTIONS_OF_ANY + INSTRUCTIONS_PER_BYTE * file_bytes) // BETWEEN_CHECKS

    def is_spent() -> bool:
        nonlocal left
        left -= 1
        return left < 0

    with closing(sqlite3.connect(address, uri=True)) as connection:
        connection.text_factory = lambda text: text.decode(errors="replace")
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, maximum_value_bytes)
        connection.set_progress_handler(is_spent, BETWEEN_CHECKS)
        connection.execute("PRAGMA trusted_schema = OFF")
        connection.execute("PRAGMA cell_size_check = ON")
        # Without it, SQLite refuses a truncated file, which has fewer pages than its header says.
        connection.execute("PRAGMA writable_schema = ON")
        yield connection


def plain_tables(connection: sqlite3.Connection) -> set[str]:
    """Return the tables whose columns are all stored: no views, virtual tables, computed columns or own `rowid`."""
    return {str(name) for (name,) in connection.execute(PLAIN_TABLES)}
