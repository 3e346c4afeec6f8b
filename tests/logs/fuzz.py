"""A byte-level fuzzer for the readers: `python -m tests.logs.fuzz --seconds 60 --seed 0`.

Small bags of every format, written by other people's tools, are cut, flipped, overwritten, repeated and spliced at
random; what is compressed as a whole is damaged before or after. Reading must end in a log or in an `InputError` of one
line, within a time and a memory limit. Inputs that do otherwise are kept and their traceback is printed; the exit
status is their number.
"""

import argparse
import collections
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
from pathlib import Path

import zstandard
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from tests.logs.conftest import load_machine, make_session
from tests.logs.messages.decoding import test_definitions as definitions
from tests.logs.samples import foreign_bags as foreign

SECONDS_PER_INPUT = 10
MEMORY_BYTES = 4 << 30
INTERESTING = [
    bytes([0]),
    b"\xff",
    b"\xff" * 4,
    b"\xff" * 8,
    b"\x00" * 8,
    b"\x7f" * 4,
    (1 << 31).to_bytes(8, "little"),
]


def corpus(folder: Path, machine) -> dict[str, bytes]:
    """Small bags by file name."""
    session = make_session(machine, seconds=3)
    ros1 = foreign.messages(foreign.ROS1, session, machine.joint_names)
    ros2 = foreign.messages(foreign.ROS2, session, machine.joint_names)
    files = []
    for compression in ("none", "bz2", "lz4"):
        files.append(foreign.write_rosbag1(folder / f"{compression}.bag", ros1, compression, 1 << 12))
    for compression in ("none", "lz4", "zstd"):
        files.append(foreign.write_mcap(folder / f"{compression}.mcap", ros2, compression))
    files.append(foreign.write_mcap(folder / "unchunked.mcap", ros2, chunked=False))
    files += foreign.write_rosbag2(folder / "nocrc", ros2, StoragePlugin.MCAP).glob("*.mcap")
    files += foreign.write_rosbag2(folder / "sqlite", ros2).glob("*.db3")
    for storage in (StoragePlugin.SQLITE3, StoragePlugin.MCAP):
        for mode in (CompressionMode.FILE, CompressionMode.MESSAGE):
            name = f"by_{mode.name.lower()}_{storage.name.lower()}"
            files += foreign.write_rosbag2(folder / name, ros2, storage, compression=mode).glob(f"{name}.*")
    files.append(definitions.write(folder / "idl.mcap", ros2, foreign.ROS2, definitions.idl))
    header = "t," + ",".join(f"{p}_{j}" for p in "qa" for j in machine.joint_names)
    rows = [f"{0.05 * i:.3f},0.1,0.2,-1,-1,0,1,0,-1" for i in range(60)]
    (folder / "table.csv").write_text("\n".join([header, *rows]))
    return {path.name: path.read_bytes() for path in [*files, folder / "table.csv"]}


def mutate(data: bytes, rng: random.Random) -> bytes:
    """Damage the bytes in one to four ways."""
    damaged = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        if not damaged:
            break
        # Structure stands at the ends: headers, definitions, index.
        at = rng.choice(
            (rng.randrange(len(damaged)), rng.randrange(min(len(damaged), 3000)), len(damaged) - 1)
        )
        kind = rng.randrange(8)
        if kind == 0:
            del damaged[at:]
        elif kind == 1:
            damaged[at] ^= 1 << rng.randrange(8)
        elif kind == 2:
            piece = rng.choice(INTERESTING)
            damaged[at : at + len(piece)] = piece
        elif kind == 3:
            del damaged[at : at + rng.randrange(1, 200)]
        elif kind == 4:
            source = rng.randrange(len(damaged))
            damaged[at:at] = damaged[source : source + rng.randrange(1, 500)]
        elif kind == 5:
            damaged[at : at + 16] = rng.randbytes(16)
        elif kind == 6:
            damaged[at] = rng.randrange(256)
        else:
            size = rng.randrange(1, 4096)
            damaged[at : at + size] = bytes(min(size, len(damaged) - at))
    return bytes(damaged)


def damage(name: str, data: bytes, rng: random.Random) -> bytes:
    """Damage a file; of a compressed one its bytes, or half of the time what they hold."""
    if name.endswith(".zstd") and rng.randrange(2):
        plain = zstandard.ZstdDecompressor().decompressobj().decompress(data)
        return zstandard.compress(mutate(plain, rng), level=1)
    return mutate(data, rng)


def try_reading(path: Path, machine) -> str:
    """Read one input and say how it ended."""
    try:
        (entry,) = find_logs(path)
        raw = read_log(entry, machine)
    except InputError as error:
        assert "\n" not in str(error) and str(error)
        return "refused"
    return "recovered with notes" if raw.notes else "read"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir()) / "fuzz_faults")
    arguments = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    signal.signal(
        signal.SIGALRM, lambda *_: (_ for _ in ()).throw(TimeoutError(f"over {SECONDS_PER_INPUT} s"))
    )
    machine, rng = load_machine("bobcat_e10"), random.Random(arguments.seed)
    outcomes, faults = collections.Counter(), 0
    with tempfile.TemporaryDirectory() as name:
        seeds = corpus(Path(name), machine)
        deadline, number = time.monotonic() + arguments.seconds, 0
        while time.monotonic() < deadline:
            original = rng.choice(sorted(seeds))
            path = Path(name) / "input" / original
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(damage(original, seeds[original], rng))
            signal.alarm(SECONDS_PER_INPUT)
            try:
                outcomes[original, try_reading(path, machine)] += 1
            except BaseException:
                if faults < 20:
                    arguments.keep.mkdir(exist_ok=True)
                    path.rename(arguments.keep / f"{arguments.seed}_{number}_{original}")
                    print(f"--- {number} {original}\n{traceback.format_exc(limit=-6)}", flush=True)
                faults += 1
            finally:
                signal.alarm(0)
            path.unlink(missing_ok=True)
            number += 1
    for (original, outcome), count in sorted(outcomes.items()):
        print(f"{original:24} {outcome:22} {count}")
    print(f"{number} inputs, {faults} faults, seed {arguments.seed}")
    return min(faults, 100)


if __name__ == "__main__":
    sys.exit(main())
