"""Storage of studies: a journal file, or a database that workers on several computers share."""

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import optuna
import sqlalchemy
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock

from pipeline.errors import InputError
from pipeline.study.database_timeout import engine_options

_CREATION_LOCK = 0x68617264  # arbitrary; other programs on the database must not lock it
_JOURNAL_BEGINNING = b'{"op_code":'  # of every line that Optuna writes


class FileLock(JournalFileOpenLock):
    """Excludes other processes while one writes to the journal.

    The kernel releases it when its holder is killed; Optuna's own locks wait half a minute. It needs a file system
    with `flock` (Linux's own, NFS from version 4).
    """

    def __init__(self, journal: Path) -> None:
        super().__init__(str(journal))
        self._journal = journal
        self._file: IO[str] | None = None

    def acquire(self) -> bool:
        """Wait for the lock; then cut off a line that a crash or a full disk left unfinished."""
        self._file = self._journal.with_name(f"{self._journal.name}.lock").open("a")
        fcntl.flock(self._file, fcntl.LOCK_EX)
        self._cut_unfinished_line()
        return True

    def release(self) -> None:
        """Release the lock."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _cut_unfinished_line(self) -> None:
        with self._journal.open("rb+") as journal:
            size = journal.seek(0, os.SEEK_END)
            if size == 0:
                return
            journal.seek(size - 1)
            if journal.read(1) != b"\n":
                journal.seek(0)
                journal.truncate(journal.read().rfind(b"\n") + 1)


def open_storage(storage: str) -> optuna.storages.BaseStorage:
    """Open a storage; create it if it is missing.

    Args:
        storage: A path (a journal file), or the URL of a database: `postgresql://…`, `sqlite:///…`.

    Raises:
        InputError: if the database cannot be reached, its driver is not installed, or the file is not a journal.
    """
    if "://" not in storage:
        return _open_journal(Path(storage))
    url = _parse(storage)
    try:
        with _creating(url):
            return optuna.storages.RDBStorage(storage, engine_kwargs=_engine_options(url))
    except (ImportError, sqlalchemy.exc.NoSuchModuleError) as error:
        raise InputError(
            f"storage={without_password(storage)}: no driver for this database is installed ({error}); "
            "use postgresql://…, sqlite:///… or a path"
        ) from error
    except sqlalchemy.exc.SQLAlchemyError as error:
        raise InputError(
            f"storage={without_password(storage)}: {getattr(error, 'orig', None) or error}; "
            "is the database up, and may this user create tables in it?"
        ) from error


def _open_journal(path: Path) -> optuna.storages.BaseStorage:
    """Check the file first: opening a journal cuts off an unfinished line, which would damage any other file."""
    refusal = InputError(
        f"storage={path}: not a journal of studies, or a damaged one; name another file, or a new one"
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists():
        with path.open("rb") as file:
            beginning = file.read(len(_JOURNAL_BEGINNING))
        if not _JOURNAL_BEGINNING.startswith(beginning):  # shorter where a crash cut it off
            raise refusal
    try:
        return optuna.storages.JournalStorage(JournalFileBackend(str(path), FileLock(path)))
    # Optuna's errors for foreign lines
    except (ValueError, LookupError, TypeError) as error:
        raise refusal from error


def without_password(storage: str) -> str:
    """The storage's address without its password."""
    return storage if "://" not in storage else _parse(storage).render_as_string(hide_password=True)


def refuse_password(storage: str) -> None:
    """Refuse a URL with a password: configurations are printed, tracked and kept with the results.

    Raises:
        InputError: if the URL holds a password or cannot be parsed.
    """
    if "://" in storage and _parse(storage).password is not None:
        raise InputError(
            f"storage={without_password(storage)}: this would be tracked with the password in it; leave the password "
            "out and give it as PGPASSWORD or in ~/.pgpass"
        )


def _parse(storage: str) -> sqlalchemy.URL:
    try:
        return sqlalchemy.make_url(storage)
    except (sqlalchemy.exc.ArgumentError, ValueError) as error:
        raise InputError(
            "storage: not the URL of a database; write postgresql://USER@HOST/DATABASE or sqlite:///FILE, or a path"
        ) from error


def _engine_options(url: sqlalchemy.URL) -> dict[str, object]:
    # Minutes may pass between two queries; a connection that was dropped meanwhile is replaced.
    return {"pool_pre_ping": True} | engine_options(url)


@contextlib.contextmanager
def _creating(url: sqlalchemy.URL) -> Iterator[None]:
    """Let one process at a time create tables: simultaneous creation of the same tables fails."""
    if url.get_backend_name() == "postgresql":
        engine = sqlalchemy.create_engine(url, **_engine_options(url))
        try:
            with engine.connect() as connection:
                connection.execute(sqlalchemy.text(f"SELECT pg_advisory_lock({_CREATION_LOCK})"))
                yield  # the lock ends with the connection
        finally:
            engine.dispose()
    elif url.get_backend_name() == "sqlite" and url.database not in (None, "", ":memory:"):
        path = Path(str(url.database))
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.with_name(f"{path.name}.lock").open("a") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield
    else:
        yield
