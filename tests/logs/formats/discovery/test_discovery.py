"""Every file that could be a log is read once, under a name of its own, or named with the reason why not."""

import os
import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest
import yaml

from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.formats.discovery.rosbag2_metadata import BagMetadata, read_metadata
from pipeline.logs.ingest import ingest
from pipeline.logs.messages.raw_log import NoteKind
from pipeline.logs.tuples import read_tuples
from tests.logs.conftest import make_session
from tests.logs.samples import foreign_bags as foreign

SECONDS = 4


@pytest.fixture(scope="module")
def files(tmp_path_factory, machine):
    """One log in three formats."""
    folder, session = tmp_path_factory.mktemp("files"), make_session(machine, SECONDS)
    entries = foreign.messages(foreign.ROS2, session, machine.joint_names)
    bag = foreign.write_rosbag2(folder / "bag", entries)
    ros1 = foreign.messages(foreign.ROS1, session, machine.joint_names)
    return {
        ".mcap": foreign.write_mcap(folder / "a.mcap", entries),
        ".bag": foreign.write_rosbag1(folder / "a.bag", ros1),
        ".db3": next(bag.glob("*.db3")),
        "metadata.yaml": bag / "metadata.yaml",
    }


@pytest.fixture
def place(files, tmp_path):
    """Puts copies of the log in the folder `logs`."""

    def put(*paths):
        for path in paths:
            target = tmp_path / "logs" / path
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(files.get(target.suffix) or files[target.name], target)
        return tmp_path / "logs"

    return put


@pytest.fixture
def run(machine, config, loop_tracker, tmp_path):
    def run(logs, output=None):
        return ingest(machine, logs, output or tmp_path / "tuples", config, loop_tracker)

    return run


def names(summary):
    return [report.name for report in summary.reports]


def notes(summary):
    kinds = (NoteKind.damage, NoteKind.attention)
    return [note.text for report in summary.reports for note in report.notes if note.kind in kinds]


def lists(*paths, **more):
    return yaml.safe_dump({"rosbag2_bagfile_information": {"relative_file_paths": list(paths), **more}})


def test_logs_beside_a_bag_are_logs_too(place, run):
    logs = place("day/run_0.db3", "day/lap.db3", "day/step.mcap", "day/old.bag", "day/deeper/x.mcap")
    (logs / "day/metadata.yaml").write_text(lists("run_0.db3"))
    summary = run(logs)
    assert names(summary) == ["day", "x", "lap", "old", "step"] and not summary.failures
    assert not notes(summary)


@pytest.mark.parametrize("text", ["title: my data set", "[" * 100_000, "a: {", "- 1", "just words"])
def test_metadata_of_something_else_hides_and_merges_nothing(place, run, text):
    logs = place("monday.mcap", "tuesday.mcap", "x.bag", "runs/y.db3")
    (logs / "metadata.yaml").write_text(text)
    summary = run(logs)
    assert names(summary) == ["monday", "y", "tuesday", "x"] and not summary.failures and not notes(summary)


@pytest.mark.parametrize("listed", ["x" * 5000, "a\0b.db3"])
def test_a_name_that_no_file_can_have_stops_nothing(place, run, listed):
    logs = place("day/run_0.db3", "other.mcap")
    (logs / "day/metadata.yaml").write_text(lists("run_0.db3", listed))
    assert names(run(logs)) == ["day", "other"]


def test_a_file_that_is_listed_twice_is_read_once(place, run):
    logs = place("day/run_0.mcap", "other.mcap")
    (logs / "day/metadata.yaml").write_text(lists("run_0.mcap", "./run_0.mcap", "x/run_0.mcap"))
    day, other = run(logs).reports
    assert day.metrics["n_rows"] == other.metrics["n_rows"] > 0


@pytest.mark.parametrize("text", ["", "rosbag2_bagfile_information: {relative_file_paths: [a", "\0\0"])
def test_damaged_metadata_does_not_merge_files_of_other_names(place, run, text):
    logs = place("monday.mcap", "tuesday.mcap")
    (logs / "metadata.yaml").write_text(text)
    assert names(run(logs)) == ["monday", "tuesday"]


def test_damaged_metadata_of_a_renamed_folder(place, machine):
    logs = place("renamed/run_0.mcap", "renamed/run_1.mcap")
    (logs / "renamed/metadata.yaml").write_text("")
    (entry,) = find_logs(logs)
    assert entry.name == "renamed" and [path.name for path in entry.files] == ["run_0.mcap", "run_1.mcap"]
    assert "metadata.yaml is damaged" in entry.notes[0].text


def test_hostile_metadata_costs_its_bag_nothing(place, run):
    """Aliases that multiply, merged mappings, and numbers in base 60 whose conversion takes for ever."""
    logs = place("bomb/run_0.mcap", "merge/run_0.mcap", "number/run_0.mcap")
    steps = list(zip("abcdefghi", "bcdefghij", strict=True))
    levels = "".join(f"{b}: &{b} [{', '.join([f'*{a}'] * 10)}]\n" for a, b in steps)
    key = "rosbag2_bagfile_information"
    (logs / "bomb/metadata.yaml").write_text(f"a: &a [x]\n{levels}{key}: {{relative_file_paths: *j}}\n")
    merged = "".join(f"{b}: &{b} {{<<: [{', '.join([f'*{a}'] * 10)}]}}\n" for a, b in steps)
    (logs / "merge/metadata.yaml").write_text(f"a: &a {{x: y}}\n{merged}{key}: *j\n")
    long = "1" + ":1" * 500_000
    (logs / "number/metadata.yaml").write_text(
        f"{key}: {{relative_file_paths: [run_0.mcap], message_count: {long}}}"
    )
    assert names(run(logs)) == ["bomb", "merge", "number"]


def test_metadata_states_files_compression_and_count(tmp_path):
    path = tmp_path / "metadata.yaml"
    path.write_text(lists("x/a_0.db3", compression_mode="FILE", compression_format="zstd", message_count=7))
    assert read_metadata(path) == BagMetadata(("x/a_0.db3",), "zstd", 7)
    path.write_text(lists("a.db3", compression_mode="", compression_format="", message_count="many"))
    assert read_metadata(path) == BagMetadata(("a.db3",))


@pytest.mark.parametrize("difference", [5, -5])
def test_the_bags_own_count_is_held_against_what_was_read(place, machine, difference):
    logs = place("run/run_0.mcap")
    (logs / "run/metadata.yaml").write_text(lists("run_0.mcap"))
    n = sum(read_log(find_logs(logs)[0], machine).message_counts.values())
    (logs / "run/metadata.yaml").write_text(lists("run_0.mcap", message_count=n + difference))
    (note,) = read_log(find_logs(logs)[0], machine).notes
    assert note.kind is NoteKind.damage and note.count == 5
    assert str(n) in note.text and str(n + difference) in note.text


def test_names_that_collide(place, run, machine, tmp_path):
    logs = place("a/b.mcap", "c/b.mcap", "a_b_mcap.mcap", "run.mcap", "run#1.mcap", "x#1.mcap")
    summary = run(logs)
    assert not summary.failures
    assert sorted(names(summary)) == ["a_b_mcap", "a_b_mcap_2", "c_b_mcap", "run", "run_1_mcap", "x#1"]
    found = [trajectory.name for trajectory in read_tuples(tmp_path / "tuples", machine)]
    assert sorted(found) == sorted(names(summary))


def test_a_log_named_as_the_second_part_of_another(run, machine, tmp_path):
    """The recording pauses for ten seconds: `run` has two trajectories."""
    session = make_session(machine, 2 * SECONDS)
    middle = session.stamp_ns[len(session.q) // 2]
    later = {
        name: getattr(session, name) + np.where(getattr(session, name) >= middle, 10**10, 0)
        for name in ("stamp_ns", "log_time_ns", "command_ns")
    }
    entries = foreign.messages(foreign.ROS2, replace(session, **later), machine.joint_names)
    for name in ("run", "run#1"):
        foreign.write_mcap(tmp_path / "logs" / f"{name}.mcap", entries)
    run(tmp_path / "logs")
    found = [trajectory.name for trajectory in read_tuples(tmp_path / "tuples", machine)]
    assert len(set(found)) == len(found) and {"run", "run#1", "run_1_mcap"} <= set(found)


def test_output_among_the_logs_is_never_read_and_names_stay(place, run):
    logs = place("a.mcap", "b/a.db3")
    first = run(logs, logs / "tuples")
    assert names(first) == ["a_mcap", "b_a_db3"]
    for output in ("tuples", "other", "tuples", "other"):
        again = run(logs, logs / output)
        assert names(again) == names(first)
        assert again.n_skipped == (2 if output == "tuples" or (logs / "seen").exists() else 0)
        if output == "other":
            (logs / "seen").touch()
    with pytest.raises(InputError, match="holds no logs but tuples in the output of ingest"):
        find_logs(logs / "tuples")


def test_links_and_copies_are_read_once_and_named(place, run):
    logs = place("run/run_0.mcap", "run/run_1.mcap", "day.bag", "day.orig.bag", "kept.db3")
    (logs / "latest.mcap").symlink_to("run/run_1.mcap")
    (logs / "again.db3").hardlink_to(logs / "kept.db3")
    (logs / "kept.db3.zst").write_bytes(b"begun")
    summary = run(logs)
    assert names(summary) == ["again", "day", "run"] and not summary.failures
    told = "\n".join(notes(summary))
    for name in ("latest.mcap", "day.orig.bag", "kept.db3", "kept.db3.zst"):
        assert f"{name} is a copy of a file of this log, or a link to one, and is not read" in told


def test_unread_compressions_are_named(place, run):
    logs = place("a.mcap")
    for name in ("b.bag.gz", "c.csv.zst", "d.parquet.xz", "notes.txt.gz"):
        (logs / name).write_bytes(b"")
    summary = run(logs)
    assert [failure.name for failure in summary.failures] == ["b.bag.gz", "c.csv.zst", "d.parquet.xz"]
    assert "b.bag.gz: compressed as .gz, which is not read; decompress it" in summary.failures[0].reason


@pytest.mark.skipif(sys.platform != "linux", reason="other file systems refuse such names")
def test_names_that_are_not_utf8(place, run):
    logs = place("a.mcap")
    odd = os.fsdecode(b"caf\xe9")
    shutil.copy(logs / "a.mcap", logs / f"{odd}.mcap")
    (logs / odd).mkdir()
    shutil.copy(logs / "a.mcap", logs / odd / "b.mcap")
    summary = run(logs)
    assert names(summary) == ["a"] and len(summary.failures) == 2
    for failure in summary.failures:
        assert "its name is not UTF-8; rename it" in failure.reason and "caf" in failure.name
        failure.name.encode()
    with pytest.raises(InputError, match="not UTF-8"):
        find_logs(logs / odd)
