"""Files that appear whole or not at all, and what is said where they cannot."""

import json
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.files.atomic import atomic_path, write_json, write_whole


def test_a_file_where_a_folder_should_be_is_named_and_left_as_it_is(tmp_path: Path) -> None:
    place = tmp_path / "notes.txt"
    place.write_text("mine")
    with pytest.raises(InputError, match=r"notes\.txt/model/x\.json: cannot be written"):
        write_whole(place / "model" / "x.json", b"{}")
    assert place.read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_nothing_is_left_of_a_file_that_was_not_finished(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="unfinished"):
        _write_half(tmp_path / "x.json")
    assert list(tmp_path.iterdir()) == []


def test_text_that_no_encoding_takes_is_written_as_json_has_it(tmp_path: Path) -> None:
    write_json(tmp_path / "x.json", {"name": "gelenk \ud800 ü"})
    assert json.loads((tmp_path / "x.json").read_text(encoding="utf-8")) == {"name": "gelenk \ud800 ü"}


def _write_half(path: Path) -> None:
    with atomic_path(path) as partial:
        partial.write_text("{")
        raise ValueError("unfinished")
