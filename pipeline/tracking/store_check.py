"""Whether a tracking store answers at all, found out within seconds.

MLflow tries again for minutes, which is right in the middle of a training and wrong before anything has begun.
"""

import contextlib
import logging
import os
from collections.abc import Iterator

from pipeline.study.database_timeout import engine_options

PATIENCE = {
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "2",
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "10",
}  # s; a user's own have precedence


@contextlib.contextmanager
def impatient() -> Iterator[None]:
    """Let MLflow's requests to a server fail within seconds, without words of their own."""
    own = {name: value for name, value in PATIENCE.items() if name not in os.environ}
    logger = logging.getLogger("urllib3.connectionpool")
    level = logger.level
    os.environ.update(own)
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)
        for name in own:
            os.environ.pop(name, None)


def ask_database(uri: str) -> None:
    """Connect to a store that is a database; nothing is done for any other.

    Raises:
        SQLAlchemyError: It cannot be reached, or is none.
        ImportError: Its driver is not installed.
    """
    import sqlalchemy
    from mlflow.store.db.db_types import DATABASE_ENGINES

    backend = uri.partition("://")[0].partition("+")[0]
    if backend not in DATABASE_ENGINES:
        return
    url = sqlalchemy.make_url(uri)
    engine = sqlalchemy.create_engine(url, **engine_options(url))
    try:
        sqlalchemy.inspect(engine).get_table_names()
    finally:
        engine.dispose()
