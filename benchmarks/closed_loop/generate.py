"""Draw cases, record their bags and seal their truths.

    python -m benchmarks.closed_loop.generate ROOT --first-seed 100 --seeds 20 [--simulator kinematic]
        [--null-seeds 60] [--kinds gain lag …]

Every kind gets as many seeds as asked for, spread over the machine variants. Bags go to `ROOT/cases/<case>/nominal`,
`measured` and `exam`, truths to `ROOT/seals/<case>.json`, baselines to `ROOT/models/<variant>`. Names of cases tell
nothing. Cases that are there are not drawn again. Cases of several simulators may lie below one root.
"""

import argparse
import hashlib
import json
import os
import shutil
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from benchmarks.closed_loop import kinds
from benchmarks.closed_loop.calibration import Calibration
from benchmarks.closed_loop.draw import draw_plan, nominal_sessions
from benchmarks.closed_loop.folders import CASE_FILE, OPEN, Folders
from benchmarks.closed_loop.machines import N_VARIANT, variant, variant_name
from benchmarks.closed_loop.sessions import Session, write
from benchmarks.closed_loop.simulator import Simulator
from benchmarks.closed_loop.simulators import KINDS, PLANT, SIMULATORS
from benchmarks.closed_loop.yardstick import yardstick
from pipeline.files.atomic import write_whole

SEAL_MODE = 0o400
NAME_LENGTH = 12


def case_name(kind: str, seed: int, simulator: Simulator = PLANT) -> str:
    """A name that tells nothing."""
    source = "" if simulator is PLANT else f", {simulator.name}"  # names of the plant's cases are older
    return hashlib.sha256(f"closed loop{source}, {kind}, {seed}".encode()).hexdigest()[:NAME_LENGTH]


def variant_of(kind: str, seed: int, n_variant: int, simulator: Simulator = PLANT) -> int:
    """Consecutive seeds of a kind meet all variants in turn, each kind beginning elsewhere."""
    return (seed + kinds.in_order(simulator.outside).index(kind)) % n_variant


def write_case(
    folders: Folders, kind: str, seed: int, n_variant: int = N_VARIANT, simulator: Simulator = PLANT
) -> bool:
    """Draw one case and write it, its seal before the file that makes it complete. False: it is there already."""
    name, number = case_name(kind, seed, simulator), variant_of(kind, seed, n_variant, simulator)
    folder = folders.cases / name
    if (folder / CASE_FILE).exists():
        return False
    plan = draw_plan(kind, seed, number, Calibration(folders.root), simulator)
    shutil.rmtree(folder, ignore_errors=True)
    if kind == kinds.IN_NOMINAL:
        _write_sessions(plan.nominal, folder / "nominal")
    else:  # the variant's bags, as hard links
        shutil.copytree(_variant_bags(folders, simulator, number), folder / "nominal", copy_function=os.link)
    for part, sessions in (("measured", plan.measured), ("exam", plan.exam)):
        _write_sessions(sessions, folder / part)
    seal = folders.seals / f"{name}.json"
    write_whole(seal, plan.truth.to_json().encode())
    seal.chmod(SEAL_MODE)
    # what is wrong in the nominal logs too is not in the variant's baseline: it must be identified anew
    model = None if kind == kinds.IN_NOMINAL else f"models/{variant_name(simulator, number)}"
    write_whole(folder / CASE_FILE, (json.dumps({"model": model}) + "\n").encode())
    return True


def _variant_bags(folders: Folders, simulator: Simulator, number: int) -> Path:
    return folders.root / "nominal" / variant_name(simulator, number)


def _write_sessions(sessions: tuple[Session, ...], folder: Path) -> None:
    folder.mkdir(parents=True)
    for session in sessions:
        write(session, folder)


def prepare_variant(root: Path, simulator: Simulator, number: int) -> None:
    """Nominal bags and baseline of a variant, unless they are there."""
    folders = Folders(root)
    bags = _variant_bags(folders, simulator, number)
    if not bags.exists():
        partial_bags = bags.with_name(f".{bags.name}.partial")
        shutil.rmtree(partial_bags, ignore_errors=True)
        _write_sessions(nominal_sessions(variant(simulator, number)), partial_bags)
        partial_bags.rename(bags)
    yardstick(root, variant(simulator, number))


def _timed(root: Path, n_variant: int, simulator: str, wanted: tuple[str, int]) -> tuple[bool, float]:
    begin = time.monotonic()
    written = write_case(Folders(root), *wanted, n_variant, SIMULATORS[simulator])
    return written, time.monotonic() - begin


def main() -> None:
    parser = argparse.ArgumentParser(prog="generate", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("root", type=Path)
    parser.add_argument("--first-seed", type=int, required=True, help="seeds count up from here")
    parser.add_argument("--seeds", type=int, required=True, help="cases of each kind")
    parser.add_argument("--null-seeds", type=int, help="cases without effect (default: as the others)")
    parser.add_argument(
        "--simulator", choices=SIMULATORS, default=PLANT.name, help="what cases are drawn from"
    )
    parser.add_argument(
        "--kinds", nargs="+", choices=KINDS, metavar="KIND", help="default: all that the simulator has"
    )
    parser.add_argument("--variants", type=int, default=N_VARIANT, help="how many machines (default: all)")
    parser.add_argument("--workers", type=int, default=1)
    arguments = parser.parse_args()
    simulator = SIMULATORS[arguments.simulator]
    known = kinds.in_order(simulator.outside)
    if unknown := sorted(set(arguments.kinds or ()) - set(known)):
        parser.error(
            f"the simulator {simulator.name} has no {', '.join(unknown)}; choose from {', '.join(known)}"
        )
    root = arguments.root.resolve()
    folders = Folders(root)
    folders.seals.mkdir(parents=True, exist_ok=True)
    folders.seals.chmod(OPEN)
    n_null = arguments.seeds if arguments.null_seeds is None else arguments.null_seeds
    wanted = [
        (kind, arguments.first_seed + number)
        for number in range(max(arguments.seeds, n_null))
        for kind in arguments.kinds or known
        if number < (n_null if kind == kinds.NULL else arguments.seeds)
    ]
    for number in sorted({variant_of(*case, arguments.variants, simulator) for case in wanted}):
        prepare_variant(root, simulator, number)
    with ProcessPoolExecutor(arguments.workers, mp_context=get_context("spawn")) as pool:
        for number, (written, seconds) in enumerate(
            pool.map(partial(_timed, root, arguments.variants, simulator.name), wanted), start=1
        ):
            note = f"{seconds:.0f} s" if written else "there already"
            print(f"case {number} of {len(wanted)}: {note}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
