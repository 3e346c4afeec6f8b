"""Draw cases by lot, record their bags and seal their truths.

    python -m benchmarks.closed_loop.generate ROOT --cases 60 [--first 8] [--simulator mujoco …] [--workers 2]

Each number is a case of each simulator, with a machine, an operator and nominal logs of its own. Bags go to
`ROOT/cases/<case>/nominal`, `measured` and `exam`, the truth to `ROOT/seals/<case>.json`. Names of cases tell nothing.
Cases that are there are not drawn again, so a run that was ended goes on where it was.
"""

import argparse
import hashlib
import shutil
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from benchmarks.closed_loop.draw import draw_plan
from benchmarks.closed_loop.folders import OPEN, Folders
from benchmarks.closed_loop.mujoco_arm.session import UnstableArmError
from benchmarks.closed_loop.sessions import Session, write
from benchmarks.closed_loop.simulator import Simulator
from benchmarks.closed_loop.simulators import SIMULATORS
from benchmarks.closed_loop.visibility import with_visible_sizes
from pipeline.files.atomic import write_whole

SEAL_MODE = 0o400
NAME_LENGTH = 12
FIRST = 8  # numbers below were machines of the benchmark before


def case_name(simulator: Simulator, number: int) -> str:
    """A name that tells nothing."""
    return hashlib.sha256(f"closed loop, {simulator.name}, {number}".encode()).hexdigest()[:NAME_LENGTH]


def write_case(folders: Folders, simulator: Simulator, number: int) -> bool:
    """Draw one case and write it, its seal before the file that makes it complete. False: it is there already."""
    name = case_name(simulator, number)
    folder = folders.cases / name
    if folders.is_complete(name):
        return False
    plan = draw_plan(simulator, number)
    shutil.rmtree(folder, ignore_errors=True)
    for part, sessions in (("nominal", plan.nominal), ("measured", plan.measured), ("exam", plan.exam)):
        _write_sessions(sessions, folder / part)
    seal = folders.seals / f"{name}.json"
    write_whole(seal, with_visible_sizes(plan).to_json().encode())
    seal.chmod(SEAL_MODE)
    folders.complete(name, plan.measured[0].specification)
    return True


def _write_sessions(sessions: Sequence[Session], folder: Path) -> None:
    folder.mkdir(parents=True)
    for session in sessions:
        write(session, folder)


def _told(root: Path, wanted: tuple[str, int]) -> str:
    begin = time.monotonic()
    simulator, number = wanted
    try:
        written = write_case(Folders(root), SIMULATORS[simulator], number)
    except UnstableArmError as error:
        return f"left out, as {error}"
    return f"{time.monotonic() - begin:.0f} s" if written else "there already"


def main() -> None:
    parser = argparse.ArgumentParser(prog="generate", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("root", type=Path)
    parser.add_argument("--cases", type=int, required=True, help="of each simulator")
    parser.add_argument("--first", type=int, default=FIRST, help="numbers count up from here")
    parser.add_argument(
        "--simulator", nargs="+", choices=SIMULATORS, default=tuple(SIMULATORS), metavar="NAME"
    )
    parser.add_argument("--workers", type=int, default=1)
    arguments = parser.parse_args()
    root = arguments.root.resolve()
    folders = Folders(root)
    folders.seals.mkdir(parents=True, exist_ok=True)
    folders.seals.chmod(OPEN)
    numbers = range(arguments.first, arguments.first + arguments.cases)
    wanted = [(simulator, number) for number in numbers for simulator in arguments.simulator]
    with ProcessPoolExecutor(arguments.workers, mp_context=get_context("spawn")) as pool:
        for done, note in enumerate(pool.map(partial(_told, root), wanted), start=1):
            print(f"case {done} of {len(wanted)}: {note}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
