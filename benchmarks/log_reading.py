"""From bytes to Parquet: the pipeline's ingest beside the plain ways a user would take.

    python -m benchmarks.log_reading                 # 76 minutes: three bags, joint states at 50 Hz, commands at 20 Hz
    python -m benchmarks.log_reading --hours 10      # twenty bags of half an hour
    python -m benchmarks.log_reading --hours 10 --bag-minutes 600   # one bag: does memory grow with it?
    python -m benchmarks.log_reading --format bag    # ROS 1, lz4 (also: mcap, db3)

Every way ends in the same Parquet columns. The plain ways read message by message, put the log on the grid with
`numpy.interp` and run the loop tracker with this project's code; none of them checks, cleans or measures anything.
The limit is reading the file and decompressing its chunks, and nothing else. Each way runs in a process of its own,
once to warm the file cache and then three times; the best counts. Ratios are to the fastest plain way, by wall time and
by processor time of the process itself. Peak memory is the process's.

Processor time on two cores, s (ingest; loop over `AnyReader`; decompression alone): 76 minutes of MCAP zstd 0.315,
3.56, 0.026; ROS 1 lz4 0.300, 4.06, 0.027; SQLite 0.361, 3.11, 0.016; ten hours of MCAP zstd 2.61, 28.5, 0.198.
"""

import argparse
import multiprocessing
import os
import struct
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars

from pipeline.configuration.load import load_machine, load_section
from pipeline.logs.conditioning.command_rules import HeldCommands
from pipeline.logs.conditioning.resample import resample
from pipeline.logs.conditioning.samples import Samples
from pipeline.logs.formats.compression.bounded_decompression import decompress
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.ingest import ingest
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.tracked_velocities import track
from pipeline.machine.specification import MachineSpecification
from tests.logs.conftest import make_session
from tests.logs.samples import foreign_bags as foreign

SESSION_MINUTES = (21, 23, 32)
LONG_BAG_MINUTES = 30
REPEATS = 3
CONFIG, TRACKER = (
    load_section("ingest", IngestConfig),
    load_section("control.loop_tracker", LoopTrackerConfig),
)


def write_bags(folder: Path, minutes: tuple[int, ...], kind: str, machine: MachineSpecification) -> None:
    for number, length in enumerate(minutes):
        session = make_session(machine, seconds=60 * length, seed=number)
        name = f"session_{number:02d}"
        if kind == "mcap":
            session.write(folder / name, machine)
        elif kind == "bag":
            entries = foreign.messages(foreign.ROS1, session, machine.joint_names)
            foreign.write_rosbag1(folder / f"{name}.bag", entries, "lz4", chunk_bytes=768 * 1024)
        else:
            entries = foreign.messages(foreign.ROS2, session, machine.joint_names)
            foreign.write_rosbag2(folder / name, entries)


def to_parquet(log: dict, machine: MachineSpecification, path: Path) -> None:
    """What the plain ways do with the samples that they read."""
    arrays = [np.array(log[key]) for key in ("stamp", "q", "command_time", "command")]
    commands = HeldCommands([Samples(*arrays[2:])])
    for segment in resample([Samples(*arrays[:2])], commands, machine.dt_s, CONFIG.maximum_gap_s, []):
        columns = {"stamp": segment.stamp_ns}
        for prefix, values in (
            ("q", segment.q),
            ("qd", track(segment.q, machine.dt_s, TRACKER)),
            ("a", segment.a),
        ):
            columns |= {f"{prefix}_{joint}": values[:, i] for i, joint in enumerate(machine.joint_names)}
        polars.DataFrame(columns).write_parquet(path)


def _empty() -> dict:
    return {"stamp": [], "q": [], "command_time": [], "command": []}


def any_reader(folder: Path, output: Path, machine: MachineSpecification) -> None:
    """Rosbags' AnyReader loop with deserialisation."""
    from rosbags.highlevel import AnyReader

    for entry in find_logs(folder):
        log = _empty()
        with AnyReader([entry.path]) as reader:
            order = None
            for connection, time_ns, data in reader.messages():
                message = reader.deserialize(data, connection.msgtype)
                if connection.topic == "/joint_states":
                    order = order or [message.name.index(joint) for joint in machine.joint_names]
                    log["stamp"].append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
                    log["q"].append(message.position[order])
                else:
                    log["command_time"].append(time_ns)
                    log["command"].append(message.data)
        to_parquet(log, machine, output / f"{entry.name}.parquet")


def mcap_ros2_support(folder: Path, output: Path, machine: MachineSpecification) -> None:
    """The mcap library with mcap-ros2-support."""
    from mcap_ros2.reader import read_ros2_messages

    for entry in find_logs(folder):
        log = _empty()
        for found in read_ros2_messages(str(entry.files[0])):
            message = found.ros_msg
            if found.channel.topic == "/joint_states":
                log["stamp"].append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
                log["q"].append(
                    [message.position[message.name.index(joint)] for joint in machine.joint_names]
                )
            else:
                log["command_time"].append(found.log_time_ns)
                log["command"].append(message.data)
        to_parquet(log, machine, output / f"{entry.name}.parquet")


def pandas_loop(folder: Path, output: Path, machine: MachineSpecification) -> None:
    """A message loop into pandas, topic by topic, as bagpy does."""
    import pandas
    from rosbags.highlevel import AnyReader

    for entry in find_logs(folder):
        frames = {}
        with AnyReader([entry.path]) as reader:
            for topic in ("/joint_states", "/joint_commands"):
                rows = []
                connections = [connection for connection in reader.connections if connection.topic == topic]
                for connection, time_ns, data in reader.messages(connections):
                    message = reader.deserialize(data, connection.msgtype)
                    row = {"Time": time_ns}
                    if topic == "/joint_states":
                        row["stamp"] = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
                        row |= {
                            f"position_{n}": p for n, p in zip(message.name, message.position, strict=True)
                        }
                    else:
                        row |= {f"data_{i}": value for i, value in enumerate(message.data)}
                    rows.append(row)
                frames[topic] = pandas.DataFrame(rows)
        states, commands = frames["/joint_states"], frames["/joint_commands"]
        log = {
            "stamp": states["stamp"].to_numpy(),
            "q": states[[f"position_{joint}" for joint in machine.joint_names]].to_numpy(),
            "command_time": commands["Time"].to_numpy(),
            "command": commands[[f"data_{i}" for i in range(machine.n_joint)]].to_numpy(float),
        }
        to_parquet(log, machine, output / f"{entry.name}.parquet")


def ours(folder: Path, output: Path, machine: MachineSpecification) -> None:
    """This project, one process: with checks, conditioning and the quality record."""
    summary = ingest(machine, folder, output, CONFIG, TRACKER, n_processes=1)
    assert not summary.failures and not summary.n_skipped


def ours_on_all_cores(folder: Path, output: Path, machine: MachineSpecification) -> None:
    """This project, side by side on all cores (the processes' start included)."""
    summary = ingest(machine, folder, output, CONFIG, TRACKER)
    assert not summary.failures and not summary.n_skipped


def limit(folder: Path, output: Path, machine: MachineSpecification) -> None:
    """Reading the files and decompressing their chunks, and nothing else."""
    for entry in find_logs(folder):
        for path in entry.files:
            {".mcap": limit_of_mcap, ".bag": limit_of_rosbag1, ".db3": limit_of_sqlite3}[path.suffix](path)


def limit_of_mcap(path: Path) -> None:
    from mcap.reader import make_reader

    with path.open("rb") as stream:
        for chunk in make_reader(stream).get_summary().chunk_indexes:
            stream.seek(chunk.chunk_start_offset + chunk.chunk_length - chunk.compressed_size)
            decompress(chunk.compression, stream.read(chunk.compressed_size), chunk.uncompressed_size)


def limit_of_rosbag1(path: Path) -> None:
    word = struct.Struct("<I")
    with path.open("rb") as stream:
        stream.seek(len("#ROSBAG V2.0\n"))
        while size := stream.read(word.size):
            header = stream.read(word.unpack(size)[0])
            (length,) = word.unpack(stream.read(word.size))
            if b"op=\x05" not in header:  # no chunk
                stream.seek(length, os.SEEK_CUR)
            else:
                decompress("lz4", stream.read(length), None)


def limit_of_sqlite3(path: Path) -> None:
    path.read_bytes()


WAYS: dict[str, Callable] = {
    "AnyReader loop": any_reader,
    "mcap-ros2-support": mcap_ros2_support,
    "loop into pandas": pandas_loop,
    "this project, 1 process": ours,
    "this project, all cores": ours_on_all_cores,
    "limit (read, decompress)": limit,
}


def measure(name: str, folder: Path, repeats: int, machine: MachineSpecification, answers) -> None:
    """Run one way and send its best wall and processor times and its peak memory."""
    times, processor = [], []
    for _ in range(1 + repeats):
        with tempfile.TemporaryDirectory() as output:
            begin, begin_processor = time.perf_counter(), time.process_time()
            WAYS[name](folder, Path(output), machine)
            times.append(time.perf_counter() - begin)
            processor.append(time.process_time() - begin_processor)
    answers.put((min(times[1:] or times), min(processor[1:] or processor), peak_mebibytes()))


def peak_mebibytes() -> float:
    """Peak memory of this process; `getrusage` would count what its parent held when it was started."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hours", type=float, default=0.0, help="a long set instead of the 76 minutes")
    parser.add_argument("--bag-minutes", type=int, default=LONG_BAG_MINUTES, help="of the long set")
    parser.add_argument("--format", choices=["mcap", "bag", "db3"], default="mcap")
    parser.add_argument("--repeats", type=int, default=REPEATS)
    parser.add_argument("--only", nargs="*", default=list(WAYS), help="which ways")
    arguments = parser.parse_args()
    machine = load_machine("bobcat_e10")
    minutes = SESSION_MINUTES
    if arguments.hours:
        minutes = (arguments.bag_minutes,) * round(arguments.hours * 60 / arguments.bag_minutes)
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_bags(folder, minutes, arguments.format, machine)
        n_bytes = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        n_messages = sum(60 * length * 70 for length in minutes)
        print(
            f"{len(minutes)} bags ({arguments.format}), {sum(minutes)} minutes, {n_messages} messages, "
            f"{n_bytes / 1e6:.1f} MB, {os.cpu_count()} cores"
        )
        rows = []
        for way in WAYS:
            if way not in arguments.only or (way == "mcap-ros2-support" and arguments.format != "mcap"):
                continue
            answers = context.Queue()
            process = context.Process(target=measure, args=(way, folder, arguments.repeats, machine, answers))
            process.start()
            rows.append((way, *answers.get()))
            process.join()
        plain = [(seconds, cpu) for way, seconds, cpu, _ in rows if way in list(WAYS)[:3]]
        fastest = [min(column) for column in zip(*plain, strict=True)]
        print(
            f"{'way':26}{'wall s':>9}{'CPU s':>9}{'messages/s':>12}{'ratio wall':>12}{'ratio CPU':>11}{'peak MiB':>10}"
        )
        for way, seconds, cpu, mebibytes in rows:
            ratios = [f"{best / own:.1f}" for best, own in zip(fastest, (seconds, cpu), strict=False)] or [
                "-",
                "-",
            ]
            print(
                f"{way:26}{seconds:9.3f}{cpu:9.3f}{n_messages / seconds:12.0f}{ratios[0]:>12}{ratios[1]:>11}"
                f"{mebibytes:10.0f}"
            )


if __name__ == "__main__":
    main()
