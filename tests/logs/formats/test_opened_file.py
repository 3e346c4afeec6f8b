"""What is not a regular file gives one line at once, wherever it is met."""

import os
import signal
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.formats.discovery.log_entry import LogEntry, LogFormat
from pipeline.logs.formats.mcap.file import read_mcap
from pipeline.logs.formats.rosbag1.file import read_rosbag1
from pipeline.logs.formats.sqlite3.file import read_sqlite3
from pipeline.logs.messages.message_blocks import ReadingLedger
from tests.logs.samples import foreign_bags as foreign

READERS = {".mcap": read_mcap, ".bag": read_rosbag1, ".db3": read_sqlite3}


@pytest.fixture(autouse=True)
def no_hang():
    """A reader that waits for a pipe's other end would wait without end."""

    def refuse(*_):
        raise TimeoutError("it waits")

    previous = signal.signal(signal.SIGALRM, refuse)
    signal.alarm(10)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, previous)


@pytest.mark.parametrize("suffix", READERS)
@pytest.mark.parametrize("compressed", ["", ".zstd"])
@pytest.mark.parametrize("kind", ["pipe", "folder", "device"])
def test_readers_refuse_what_is_no_file(tmp_path, suffix, compressed, kind):
    path = tmp_path / f"a{suffix}{compressed}"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to("/dev/zero")
    with pytest.raises(InputError, match=rf"{path.name}: a .*{kind}, not a file") as error:
        list(READERS[suffix](path, ReadingLedger(path), {"/joint_states"}))
    assert "\n" not in str(error.value)


def test_pipe_beside_a_log_costs_only_itself(tmp_path, machine, session):
    session.write(tmp_path / "good", machine)
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "folder.mcap").mkdir()
    (tmp_path / "lost.bag").symlink_to(tmp_path / "nowhere")
    folder, good, lost, pipe = find_logs(tmp_path)
    assert len(read_log(good, machine).q) == len(session.q)
    for entry, reason in ((folder, "a folder without logs"), (lost, "No such file"), (pipe, "a named pipe")):
        with pytest.raises(InputError, match=reason):
            read_log(entry, machine)


def test_metadata_that_is_a_pipe(tmp_path, machine):
    os.mkfifo(tmp_path / "metadata.yaml")
    (entry,) = find_logs(tmp_path)
    with pytest.raises(InputError, match=r"metadata\.yaml: a named pipe"):
        read_log(entry, machine)


def test_damage_in_a_split_bag_names_the_file(tmp_path, machine, session):
    entries = foreign.messages(foreign.ROS2, session, machine.joint_names)
    half = len(entries) // 2
    foreign.write_mcap(tmp_path / "run" / "run_0.mcap", entries[:half])
    foreign.write_mcap(tmp_path / "run" / "run_1.mcap", entries[half:])
    path = tmp_path / "run" / "run_1.mcap"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    (entry,) = find_logs(tmp_path)
    raw = read_log(entry, machine)
    assert raw.notes and all(note.text.startswith("run_1.mcap, byte ") for note in raw.notes)


def test_file_that_vanishes(tmp_path, machine):
    path = Path(tmp_path / "a.mcap")
    with pytest.raises(InputError, match=r"No such file or directory.*check that it is still there"):
        read_log(LogEntry("a", path, LogFormat.mcap, (path,)), machine)


def test_pipe_among_a_bags_files_costs_only_itself(tmp_path, machine, session):
    entries = foreign.messages(foreign.ROS2, session, machine.joint_names)
    foreign.write_mcap(tmp_path / "run" / "run_0.mcap", entries)
    os.mkfifo(tmp_path / "run" / "run_1.mcap")
    text = "rosbag2_bagfile_information: {relative_file_paths: [run_0.mcap, run_1.mcap]}"
    (tmp_path / "run" / "metadata.yaml").write_text(text)
    (entry,) = find_logs(tmp_path)
    raw = read_log(entry, machine)
    assert len(raw.q) == len(session.q) and "run_1.mcap" in raw.notes[0].text
    (tmp_path / "run" / "metadata.yaml").unlink()
    whole, pipe = find_logs(tmp_path)
    assert len(read_log(whole, machine).q) == len(session.q) and "a named pipe" in pipe.error


def test_links_lead_to_every_log_once(tmp_path, machine, session):
    session.write(tmp_path / "b" / "good", machine)
    for folder, target in (("a", "b"), ("b/back", "."), ("b/itself", "b/itself")):
        (tmp_path / folder).symlink_to(tmp_path / target)
    (entry,) = find_logs(tmp_path)
    assert entry.path == tmp_path / "b" / "good"
