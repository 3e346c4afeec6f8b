"""Connection time-out of a database."""

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sqlalchemy import URL

CONNECT_TIMEOUT_S = 10
KEY = "connect_timeout"
# Drivers that accept the key; the others fail on it.
DRIVERS = ("psycopg", "psycopg2", "mysqldb", "pymysql")
VARIABLE = "PGCONNECT_TIMEOUT"  # PostgreSQL's own


def engine_options(url: "URL") -> dict[str, object]:
    """Arguments of `sqlalchemy.create_engine`; a time-out in URL or environment has precedence.

    Raises:
        SQLAlchemyError: The kind of database is unknown.
    """
    is_given = KEY in url.query or (url.get_backend_name() == "postgresql" and VARIABLE in os.environ)
    if is_given or url.get_driver_name() not in DRIVERS:
        return {}
    return {"connect_args": {KEY: CONNECT_TIMEOUT_S}}
