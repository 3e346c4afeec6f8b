"""Folders of bags whose metadata or files are damaged or missing."""

from pathlib import Path

from tests.logs.damage.case import Damaged, case, refused
from tests.logs.samples import foreign_bags as foreign
from tests.logs.samples.whole_logs import (
    SQLITE,
    WholeLog,
    entries_of,
)


def split_bag(folder: Path, log: WholeLog, metadata: str = "") -> tuple[Path, list[int]]:
    """A bag of three files; return the messages of each."""
    entries = entries_of(foreign.ROS2)
    bag = folder / "run"
    bag.mkdir()
    third = len(entries) // 3
    counts = []
    for number in range(3):
        part = entries[number * third : (number + 1) * third if number < 2 else None]
        if log.kind == SQLITE:
            (file,) = foreign.write_rosbag2(folder / f"part{number}", part).glob("*.db3")
            file.rename(bag / f"run_{number}.db3")
            for rest in (folder / f"part{number}").iterdir():
                rest.unlink()
            (folder / f"part{number}").rmdir()
        else:
            foreign.write_mcap(bag / f"run_{number}.mcap", part)
        counts.append(len(part))
    files = ", ".join(f"run_{number}{log.suffix}" for number in range(3))
    text = metadata or f"rosbag2_bagfile_information: {{relative_file_paths: [{files}]}}\n"
    (bag / "metadata.yaml").write_text(text)
    return bag, counts


@case("damaged metadata.yaml", "MCAP, zstd", SQLITE)
def damaged_metadata(folder: Path, log: WholeLog) -> Damaged:
    bag, counts = split_bag(folder, log, "rosbag2_bagfile_information: [\x00\n\t- {")
    return Damaged(bag, sum(counts))


@case("empty metadata.yaml", "MCAP, zstd", SQLITE)
def empty_metadata(folder: Path, log: WholeLog) -> Damaged:
    bag, counts = split_bag(folder, log)
    (bag / "metadata.yaml").write_bytes(b"")  # as a crash leaves it
    return Damaged(bag, sum(counts))


@case("metadata.yaml of another structure", "MCAP, zstd")
def odd_metadata(folder: Path, log: WholeLog) -> Damaged:
    bag, counts = split_bag(folder, log, "rosbag2_bagfile_information: [{relative_file_paths: 3}]")
    return Damaged(bag, sum(counts))


@case("file of a split bag missing", "MCAP, zstd", SQLITE)
def missing_part(folder: Path, log: WholeLog) -> Damaged:
    bag, counts = split_bag(folder, log)
    name = f"run_1{log.suffix}"
    (bag / name).unlink()
    return Damaged(bag, counts[0] + counts[2], (f"run: file {name} is listed .* missing",))


@case("empty last file of a split bag", "MCAP, zstd", SQLITE)
def empty_part(folder: Path, log: WholeLog) -> Damaged:
    """The recorder was killed just after it began a new file."""
    bag, counts = split_bag(folder, log)
    (bag / f"run_2{log.suffix}").write_bytes(b"")
    return Damaged(bag, counts[0] + counts[1], (f"run_2{log.suffix}",))


@case("damaged file of a split bag", "MCAP, zstd", SQLITE)
def damaged_part(folder: Path, log: WholeLog) -> Damaged:
    bag, counts = split_bag(folder, log)
    (bag / f"run_1{log.suffix}").write_bytes(b"\xff" * 5000)
    return Damaged(bag, counts[0] + counts[2], (f"run_1{log.suffix}",))


@case("bag folder without files", "MCAP, zstd")
def no_parts(folder: Path, log: WholeLog) -> Damaged:
    bag, _ = split_bag(folder, log)
    for number in range(3):
        (bag / f"run_{number}.mcap").unlink()
    return refused(bag, "without its files")
