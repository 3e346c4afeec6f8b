"""A private PostgreSQL server for a test: its own data folder, no network, gone afterwards."""

import contextlib
import importlib.util
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

UNPRIVILEGED = "nobody"  # the server refuses to run as root
START_TIMEOUT_S = 30
STOP_TIMEOUT_S = 10


@contextlib.contextmanager
def postgresql_server() -> Iterator[dict[str, str]]:
    """Run a server; gives the environment in which `postgresql:///postgres` is its database."""
    initdb = find_initdb()
    if initdb is None:
        pytest.skip("no PostgreSQL server: install the Debian package postgresql")
    if importlib.util.find_spec("psycopg") is None:
        pytest.skip("no PostgreSQL driver: psycopg is not installed")
    folder = Path(
        tempfile.mkdtemp(prefix="pg_", dir="/tmp")
    )  # a socket's path is at most 107 characters long
    server = None
    try:
        user = []
        if os.getuid() == 0:
            shutil.chown(folder, UNPRIVILEGED)
            user = ["--reuid", UNPRIVILEGED, "--clear-groups"]
        # The kernel ends the server when this process is killed.
        unprivileged = ["setpriv", *user, "--pdeathsig", "QUIT", "--"]
        data, log = folder / "data", folder / "log"
        options = ["--auth=trust", "--username=search", "--no-sync", "--encoding=UTF8", "--locale=C"]
        subprocess.run(
            [*unprivileged, initdb, *options, str(data)], check=True, capture_output=True, cwd=folder
        )
        settings = ["listen_addresses=", f"unix_socket_directories={folder}", "fsync=off"]
        command = [str(initdb.with_name("postgres")), "-D", str(data)]
        with log.open("w") as output:
            server = subprocess.Popen(
                [*unprivileged, *command, *(word for setting in settings for word in ("-c", setting))],
                cwd=folder,
                stdout=output,
                stderr=subprocess.STDOUT,
            )
        environment = {"PGHOST": str(folder), "PGUSER": "search"}
        _wait_until_ready(initdb.with_name("pg_isready"), os.environ | environment, server, log)
        yield environment
    finally:
        if server is not None and server.poll() is None:
            server.send_signal(signal.SIGINT)  # fast shutdown
            try:
                server.wait(STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                server.kill()
                server.wait()
        shutil.rmtree(folder, ignore_errors=True)


def find_initdb() -> Path | None:
    """Debian keeps the server's programs out of PATH."""
    on_path = shutil.which("initdb")
    if on_path is not None:
        return Path(on_path).resolve()  # the server's other programs lie beside it
    installed = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    return installed[-1] if installed else None


def _wait_until_ready(
    pg_isready: Path, environment: dict[str, str], server: subprocess.Popen, log: Path
) -> None:
    deadline_s = time.monotonic() + START_TIMEOUT_S
    while subprocess.run([pg_isready, "--quiet"], env=environment, check=False).returncode != 0:
        if server.poll() is not None or time.monotonic() > deadline_s:
            pytest.fail(f"the PostgreSQL server did not start:\n{log.read_text()}")
        time.sleep(0.05)
