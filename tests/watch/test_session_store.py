"""What a watch keeps: facts about sessions, each once."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.watch.session_store import SessionRecord, SessionStore, in_order

SECOND = 10**9


def record(name: str, begin_s: int, end_s: int) -> SessionRecord:
    content = hashlib.sha256(f"{begin_s} {end_s}".encode()).hexdigest()
    files = [[f"/logs/{name}.mcap 1 1"]]
    values: list[list[float | None]] = [[0.1, 0.2], [None, None]]
    return SessionRecord(
        content, name, f"/logs/{name}", files, begin_s * SECOND, end_s * SECOND, "key", values
    )


def test_sessions_are_in_the_order_of_recording_whenever_they_arrive(tmp_path: Path) -> None:
    store = SessionStore(tmp_path)
    for name, begin in (("c", 300), ("a", 100), ("b", 200)):
        store.add(record(name, begin, begin + 50))
    ordered, parts = in_order(SessionStore(tmp_path).records.values())
    assert [of.name for of in ordered] == ["a", "b", "c"]
    assert not parts


def test_a_session_under_another_name_counts_once_and_is_not_read_again(tmp_path: Path) -> None:
    store, one = SessionStore(tmp_path), record("a", 100, 200)
    store.add(one)
    store.add(replace(one, name="copy", path="/logs/copy", files=[["/logs/copy.mcap 1 2"]]))
    (kept,) = SessionStore(tmp_path).records.values()
    assert kept.files == [["/logs/a.mcap 1 1"], ["/logs/copy.mcap 1 2"]]


def test_of_a_log_that_was_read_while_it_grew_the_whole_counts() -> None:
    half, whole = record("a", 100, 150), record("a", 100, 200)
    ordered, parts = in_order([half, whole])
    assert ordered == [whole]
    assert not parts  # it is the same log
    cut = record("cut", 120, 200)
    assert in_order([cut, whole]) == ([whole], [("cut", "a")])


def test_a_file_that_a_killed_look_left_unfinished_is_no_session(tmp_path: Path) -> None:
    store = SessionStore(tmp_path)
    store.add(record("a", 100, 200))
    (tmp_path / "sessions/.b.json.77.partial").write_text('{"content": "b", "na')
    assert len(SessionStore(tmp_path).records) == 1


def test_damage_is_one_line(tmp_path: Path) -> None:
    store = SessionStore(tmp_path)
    store.add(record("a", 100, 200))
    (path,) = (tmp_path / "sessions").glob("*.json")
    path.write_text("{")
    with pytest.raises(InputError, match=r"not the record of a session .* delete it"):
        SessionStore(tmp_path)


def test_maintenance_twice_at_once_is_one(tmp_path: Path) -> None:
    store = SessionStore(tmp_path)
    for stamp in (5 * SECOND, 3 * SECOND, 5 * SECOND):
        store.begin_baseline(stamp)
    assert SessionStore(tmp_path).baselines() == [3 * SECOND, 5 * SECOND]
    (tmp_path / "baselines.json").write_text(json.dumps({"a": 1}))
    with pytest.raises(InputError, match="not a list of stamps"):
        store.baselines()
