"""Looks at a machine of two joints, whose logs are bags that grow in number from look to look."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.watch import look as look_module
from pipeline.watch.look import look
from pipeline.watch.watch_inputs import stamp_of
from tests.watch.two_joints import DAY_S, FIRST_S, learn, paths, settings, write_session


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ten nominal sessions, and what a first look learned of them."""
    root = tmp_path_factory.mktemp("watch")
    document = learn(root)
    assert (document["state"], document["sessions"]) == ("not_enough", [])
    return root


@pytest.fixture
def root(learned: Path, tmp_path: Path) -> Path:
    """The same, for one test."""
    shutil.copytree(learned / "state", tmp_path / "state")
    (tmp_path / "nominal").symlink_to(learned / "nominal")
    (tmp_path / "sessions").mkdir()
    return tmp_path


def said(root: Path) -> dict[str, object]:
    return json.loads((root / "output/watch.json").read_text())  # type: ignore[no-any-return]


def test_a_sound_machine_is_healthy_and_logs_are_read_once(root, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    for day in (12, 11, 13):
        write_session(root / "sessions", day)
    document = look(paths(root), settings())
    assert said(root) == document
    assert document["state"] == "healthy"
    assert [of["name"] for of in document["sessions"]] == ["day_011", "day_012", "day_013"]
    assert all(of["joints"]["turn"]["state"] == "healthy" for of in document["sessions"])
    monkeypatch.setattr(look_module, "read_session", None)  # nothing is to be read any more
    assert look(paths(root), settings()) == document


def test_copies_new_names_and_broken_logs_do_no_harm(root: Path) -> None:
    path = write_session(root / "sessions", 11)
    before = look(paths(root), settings())
    shutil.copytree(path, root / "sessions/other_name")
    shutil.copytree(root / "nominal/day_003", root / "sessions/nominal_again")
    broken = write_session(root / "sessions", 12) / "day_012_0.mcap"
    (mcap,) = broken.parent.glob("*.mcap")
    mcap.write_bytes(b"nothing")
    after = look(paths(root), settings())
    assert [of["begin"] for of in after["sessions"]] == [of["begin"] for of in before["sessions"]]
    why = {of["name"]: of["why"] for of in after["not_counted"]}
    assert set(why) == {"day_012", "nominal_again"}
    assert "nominal sessions" in why["nominal_again"] and "day_012" in why["day_012"]


def test_late_sessions_stand_where_they_were_recorded(root: Path) -> None:
    for day in (11, 13):
        write_session(root / "sessions", day)
    write_session(root / "late", 12)
    look(paths(root), settings())
    (root / "late/day_012").rename(root / "sessions/day_012")
    late = look(paths(root), settings())
    shutil.rmtree(root / "state/sessions")
    assert look(paths(root), settings()) == late


def test_a_look_that_was_killed_is_gone_on_with(root: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    for day in (11, 12, 13):
        write_session(root / "sessions", day)
    read, calls = look_module.read_session, []

    def killed(entry, of):  # type: ignore[no-untyped-def]
        calls.append(entry.name)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return read(entry, of)

    monkeypatch.setattr(look_module, "read_session", killed)
    with pytest.raises(KeyboardInterrupt):
        look(paths(root), settings())
    document = look(paths(root), settings())
    assert [of["name"] for of in document["sessions"]] == ["day_011", "day_012", "day_013"]
    assert sorted(calls) == ["day_011", "day_012", "day_012", "day_013"]


def test_maintenance_begins_a_baseline(root: Path) -> None:
    for day in (11, 12, 13):
        write_session(root / "sessions", day)
    from_12 = replace(paths(root), baseline_ns=(FIRST_S + 12 * DAY_S - 60) * 10**9)
    document = look(from_12, settings())
    assert [of["is_baseline"] for of in document["sessions"]] == [False, True, True]
    assert document["state"] == "not_enough"
    assert look(paths(root), settings()) == document  # once told, it holds


def test_logs_that_teach_nothing_are_one_line(tmp_path: Path) -> None:
    write_session(tmp_path / "nominal", 0, minutes=0.1)
    (tmp_path / "sessions").mkdir()
    with pytest.raises(InputError, match=r"^nominal=.*nominal: identify: "):
        look(paths(tmp_path), settings())
    with pytest.raises(
        InputError, match=r"^.*no_model/meta.json: "
    ):  # told before nominal logs are learned from
        look(replace(paths(tmp_path), model=tmp_path / "no_model"), settings())
    (tmp_path / "sessions").rmdir()
    with pytest.raises(InputError, match=r"^.*sessions: no such folder"):
        look(paths(tmp_path), settings())
    with pytest.raises(InputError, match="not a time; write now, or "):
        stamp_of("yesterday")


def test_an_alarm_is_written_whatever_comes_of_its_cause(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def cannot(*_: object) -> None:
        raise InputError("nominal logs show the effects already")

    monkeypatch.setattr(look_module, "cause_of", cannot)
    for day in range(11, 15):
        write_session(root / "sessions", day, slower=0.7)
    with pytest.raises(InputError, match="show the effects already"):
        look(paths(root), settings())
    assert said(root)["state"] == "changed"


@pytest.mark.long
def test_a_change_is_told_with_its_session_and_its_cause(root: Path) -> None:
    for day in range(11, 15):
        write_session(root / "sessions", day)
    assert look(paths(root), settings())["state"] == "healthy"
    for day in range(15, 18):
        write_session(root / "sessions", day, slower=0.7, minutes=4.0)
    document = look(paths(root), settings())
    assert document["state"] == "changed"
    (finding,) = document["findings"]
    assert finding["joints"] == ["turn"]
    assert finding["onset"]["session"] == "day_015"
    assert finding["size"]["statistic"] == "speed_backward"
    (effect,) = finding["cause"]["closed_loop"]["effects"]
    assert (effect["family"], effect["joints"]) == ("gain", ["turn"])
    assert effect["parameters"]["speed_ratio"]["value"] == pytest.approx(0.7, abs=0.05)
    corrected = root / "corrected"  # yesterday's model, which has the effect already
    (root / "output" / finding["cause"]["folder"] / "model_after").rename(corrected)
    shutil.rmtree(root / "output")
    (again,) = look(replace(paths(root), model=corrected), settings())["findings"]
    answer = again["cause"]["closed_loop"]
    assert answer["effects"] == [] and [of["family"] for of in answer["known"]] == ["gain"]
    for day in (18, 19):
        write_session(root / "sessions", day)
    repaired = look(paths(root), settings())
    assert (repaired["state"], repaired["findings"][0]["until"]) == ("healthy", "day_018")
