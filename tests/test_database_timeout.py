"""How long trackers and studies wait for a database: seconds, unless the user says otherwise."""

import psycopg
import pytest
import sqlalchemy

from pipeline.errors import InputError
from pipeline.study.database_timeout import CONNECT_TIMEOUT_S, engine_options
from pipeline.study.storage import open_storage
from pipeline.tracking.store_check import check_database

OURS = {"connect_args": {"connect_timeout": CONNECT_TIMEOUT_S}}


@pytest.fixture(autouse=True)
def no_timeout_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PGCONNECT_TIMEOUT", raising=False)


@pytest.mark.parametrize(
    ("url", "options"),
    [
        ("postgresql://h/d", OURS),
        ("postgresql+psycopg2://h/d", OURS),
        ("mysql+pymysql://h/d", OURS),
        ("postgresql://h/d?connect_timeout=60", {}),
        ("mysql+pymysql://h/d?connect_timeout=60", {}),
        ("postgresql+pg8000://h/d", {}),  # would raise TypeError
        ("postgresql+asyncpg://h/d", {}),
        ("sqlite:///a.db", {}),
    ],
)
def test_only_where_none_is_given_and_the_driver_takes_one(url: str, options: dict) -> None:
    assert engine_options(sqlalchemy.make_url(url)) == options


def test_postgresqls_own_variable_has_precedence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PGCONNECT_TIMEOUT", "60")
    assert engine_options(sqlalchemy.make_url("postgresql://h/d")) == {}
    assert engine_options(sqlalchemy.make_url("mysql+pymysql://h/d")) == OURS


@pytest.mark.parametrize(("query", "timeout"), [("", CONNECT_TIMEOUT_S), ("?connect_timeout=60", "60")])
def test_the_driver_is_told(query: str, timeout: object, monkeypatch: pytest.MonkeyPatch) -> None:
    told = []

    def connect(*_: object, **arguments: object) -> None:
        told.append(arguments["connect_timeout"])
        raise psycopg.OperationalError("nobody there")

    monkeypatch.setattr(psycopg, "connect", connect)
    url = f"postgresql+psycopg://nobody@127.0.0.1:9/studies{query}"
    with pytest.raises(sqlalchemy.exc.OperationalError):
        check_database(url)
    with pytest.raises(InputError, match="nobody there"):
        open_storage(url)
    assert set(told) == {timeout} and len(told) >= 2
