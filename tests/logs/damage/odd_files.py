"""Permissions, full disks, links, pipes and files of ten gigabytes."""

import os
from pathlib import Path

from tests.logs.damage.bag_folders import split_bag
from tests.logs.damage.case import REFUSED, Damaged, Where, case, refused
from tests.logs.samples.whole_logs import (
    MCAP_CHUNKED,
    SQLITE,
    TABLES,
    WholeLog,
)

SPARSE_BYTES = 10 << 30


@case("no permission to read the file", "ROS 1", "MCAP", SQLITE, *TABLES, where=Where.unprivileged)
def unreadable_file(folder: Path, log: WholeLog) -> Damaged:
    path = log.write(folder / "a")
    path.chmod(0)
    return refused(path, r"cannot be read \(Permission denied\); check")


@case("no permission to list the folder", "MCAP, zstd", where=Where.unprivileged)
def unreadable_folder(folder: Path, log: WholeLog) -> Damaged:
    bag, _ = split_bag(folder, log)
    bag.chmod(0)
    return refused(bag, "Permission denied")


@case("no permission to enter the folder", "MCAP, zstd", SQLITE, where=Where.unprivileged)
def locked_folder(folder: Path, log: WholeLog) -> Damaged:
    """It can be listed, and nothing in it opened."""
    bag, _ = split_bag(folder, log)
    (bag / "metadata.yaml").unlink()
    bag.chmod(0o444)
    return refused(bag, "Permission denied")


@case("no permission to read metadata.yaml", "MCAP, zstd", where=Where.unprivileged)
def unreadable_metadata(folder: Path, log: WholeLog) -> Damaged:
    bag, _ = split_bag(folder, log)
    (bag / "metadata.yaml").chmod(0)
    return refused(bag, "metadata.yaml: cannot be read")


@case("output folder not writable", "MCAP, zstd", where=Where.unprivileged)
def locked_output(folder: Path, log: WholeLog) -> Damaged:
    output = folder / "output"
    output.mkdir()
    output.chmod(0o555)
    path = log.write(folder / "a")
    return Damaged(path, 0, (r"output.*cannot be (written|made) \(Permission denied\)",), REFUSED)


@case("output is a file", "MCAP, zstd")
def output_is_a_file(folder: Path, log: WholeLog) -> Damaged:
    (folder / "output").write_text("in the way")
    path = log.write(folder / "a")
    return Damaged(path, 0, (r"output: cannot be made \(File exists\)",), REFUSED)


@case("full disk", "MCAP, zstd", SQLITE, "CSV", where=Where.full_disk)
def full_disk(folder: Path, log: WholeLog) -> Damaged:
    path = log.write(folder / "a")
    return Damaged(path, 0, (r"cannot be written .*make room",), REFUSED)


@case("symbolic link to itself", "MCAP")
def link_to_itself(folder: Path, log: WholeLog) -> Damaged:
    """Beside a good log, which must be read."""
    logs = folder / "logs"
    logs.mkdir()
    log.write(logs / "good")
    (logs / "a.mcap").symlink_to("a.mcap")
    return Damaged(logs, log.n_messages, (r"a\.mcap",), REFUSED)


@case("folders that link to each other", "MCAP")
def loops_of_links(folder: Path, log: WholeLog) -> Damaged:
    """Eight folders with a link to every other: a hundred thousand ways through them."""
    logs = folder / "logs"
    folders = [logs / f"folder{number}" for number in range(8)]
    for one in folders:
        one.mkdir(parents=True)
        for other in folders:
            (one / other.name).symlink_to(other)
    log.write(folders[0] / "good")
    return Damaged(logs, log.n_messages)


@case("named pipe", "ROS 1", "MCAP", SQLITE, *TABLES)
def named_pipe(folder: Path, log: WholeLog) -> Damaged:
    """To open it would wait for ever."""
    path = folder / f"a{log.suffix}"
    os.mkfifo(path)
    return refused(path)


@case("named pipe in a bag folder", "MCAP, zstd")
def named_pipe_in_a_bag(folder: Path, log: WholeLog) -> Damaged:
    bag, counts = split_bag(folder, log)
    (bag / "run_2.mcap").unlink()
    os.mkfifo(bag / "run_2.mcap")
    return Damaged(bag, counts[0] + counts[1], (r"run_2\.mcap",))


@case("named pipe as metadata.yaml", "MCAP, zstd")
def named_pipe_as_metadata(folder: Path, log: WholeLog) -> Damaged:
    bag, _ = split_bag(folder, log)
    (bag / "metadata.yaml").unlink()
    os.mkfifo(bag / "metadata.yaml")
    return Damaged(bag, 0, ("metadata.yaml",), REFUSED)


@case("folder with a log's suffix", "MCAP", "CSV")
def folder_as_log(folder: Path, log: WholeLog) -> Damaged:
    path = folder / f"a{log.suffix}"
    path.mkdir()
    return refused(path, "holds no logs")


@case("10 GB of zeros behind the log", "ROS 1", *MCAP_CHUNKED[:1], SQLITE, where=Where.fused, only_read=True)
def zeros_behind(folder: Path, log: WholeLog) -> Damaged:
    """As a file system leaves what was allotted and not written when the power failed; the index is gone."""
    end = log.chunks[-1].end if log.chunks else len(log.content)
    path = log.write(folder / "a", log.content[:end])
    os.truncate(path, SPARSE_BYTES)
    return Damaged(path, log.n_messages)


@case("10 GB of zeros behind the log", "CSV", where=Where.fused, only_read=True)
def zeros_behind_rows(folder: Path, log: WholeLog) -> Damaged:
    path = log.write(folder / "a")
    os.truncate(path, SPARSE_BYTES)
    return Damaged(path, log.n_messages)


@case("10 GB of zeros", "ROS 1", "MCAP", SQLITE, *TABLES, where=Where.fused, only_read=True)
def zeros(folder: Path, log: WholeLog) -> Damaged:
    path = log.write(folder / "a", b"")
    os.truncate(path, SPARSE_BYTES)
    return refused(path)
