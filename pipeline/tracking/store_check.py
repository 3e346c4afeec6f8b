"""Check within seconds whether a tracking store answers.

MLflow retries for minutes, which suits a running training but not a start.
"""

import contextlib
import logging
import os
from collections.abc import Iterator

from pipeline.study.database_timeout import engine_options

SHORT_TIMEOUTS = {
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "2",
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "10",
}  # s; the user's own values have precedence


@contextlib.contextmanager
def short_timeouts() -> Iterator[None]:
    """Let MLflow's requests to a server fail within seconds, without log messages."""
    own = {name: value for name, value in SHORT_TIMEOUTS.items() if name not in os.environ}
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


def check_database(uri: str) -> None:
    """Connect to a store that is a database; ignore other stores.

    Raises:
        SQLAlchemyError: The database cannot be reached, or the address cannot be parsed.
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
