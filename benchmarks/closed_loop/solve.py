"""Run `close_loop` on every case, one process each, which sees folders of bags and cannot read the seals.

    python -m benchmarks.closed_loop.solve ROOT [--workers 2] [--timeout 900] [--limit 10] [overrides …]

Solutions go to `ROOT/solutions/<case>`: what `close_loop` wrote, `log.txt`, `run.json` (exit status, seconds,
fingerprint of the code) and `exam.json` (errors on the exam logs, measured here). Each case's baseline is identified
from its own nominal logs. Overrides are handed on to `close_loop`. Cases that this code has solved are not run again,
so a run may be ended at any time and goes on later. Those whose run failed are run again with `--again`.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import jax

from benchmarks.closed_loop import blind
from benchmarks.closed_loop.examine import examine
from benchmarks.closed_loop.folders import CONFIGURATION, Folders, sealed
from benchmarks.closed_loop.ledger import fingerprint
from pipeline.errors import InputError
from pipeline.files.atomic import write_whole

RUN_FILE, LOG_FILE, EXAM_FILE = "run.json", "log.txt", "exam.json"
TIMED_OUT = "timeout"
CLOSE_LOOP = "pipeline.stages.close_loop"


@dataclass(frozen=True)
class Task:
    """One case to solve. `arguments` go to `close_loop`."""

    name: str
    case: Path
    solution: Path
    arguments: tuple[str, ...]


def tasks(folders: Folders, overrides: Sequence[str]) -> list[Task]:
    """All complete cases with their arguments."""
    found = []
    for name in folders.complete_cases():
        case, solution = folders.cases / name, folders.solutions / name
        arguments = (
            f"nominal={case / 'nominal'}",
            f"measured={case / 'measured'}",
            f"output={solution}",
            f"machine={folders.machine(name).name}",
            "tracking=none",
            "page=false",
            *overrides,
            "--config-dir",
            str(case / CONFIGURATION),
        )
        found.append(Task(name, case, solution, arguments))
    return found


def run(task: Task, seals: Path, timeout_s: float, module: str = CLOSE_LOOP) -> None:
    """Run `close_loop` in a process that cannot read `seals`, in a working folder of its own."""
    shutil.rmtree(task.solution, ignore_errors=True)
    task.solution.mkdir(parents=True)
    command = [sys.executable, str(Path(blind.__file__).resolve()), str(seals)]
    command += [sys.executable, "-m", module, *task.arguments]
    code, begin = fingerprint(), time.monotonic()
    with (
        tempfile.TemporaryDirectory(prefix="close_loop_") as working,
        (task.solution / LOG_FILE).open("w") as log,
    ):
        process = subprocess.Popen(
            command,
            cwd=working,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},  # the log of a run that hangs tells how far it came
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        status: int | str
        try:
            status = process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            status = TIMED_OUT
            os.killpg(process.pid, signal.SIGKILL)  # with whatever it has started
            process.wait()
    if status == blind.STILL_READABLE:
        raise SystemExit((task.solution / LOG_FILE).read_text())
    result = {"status": status, "seconds": round(time.monotonic() - begin, 1), "code": code}
    write_whole(task.solution / RUN_FILE, (json.dumps(result) + "\n").encode())


def is_solved(task: Task, again: bool) -> bool:
    """Whether this code has run it; with `again` only if that run went well."""
    run_file = task.solution / RUN_FILE
    if not run_file.exists():
        return False
    result = json.loads(run_file.read_text())
    return result["code"] == fingerprint() and (not again or result["status"] == 0)


_examination = threading.Lock()  # one at a time: both cores belong to the solvers


def examine_solution(folders: Folders, task: Task) -> None:
    """Measure the errors of a solved case, once; why it could not be done stands in the log."""
    exam = task.solution / EXAM_FILE
    if exam.exists() or json.loads((task.solution / RUN_FILE).read_text())["status"] != 0:
        return
    with _examination:
        try:
            examine(task.case / "exam", folders.machine(task.name), task.solution, exam)
        except InputError as error:
            with (task.solution / LOG_FILE).open("a") as log:
                log.write(f"examination: {error}\n")
        jax.clear_caches()  # each case compiles its own models


def main() -> None:
    parser = argparse.ArgumentParser(prog="solve", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("root", type=Path)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--timeout", type=float, default=900.0, help="seconds per case")
    parser.add_argument("--module", default=CLOSE_LOOP, help="another solver with the same command line")
    parser.add_argument("--again", action="store_true", help="run failed cases once more")
    parser.add_argument("--cases", nargs="+", metavar="CASE", help="only these")
    parser.add_argument("--limit", type=int, help="run so many cases in this sitting")
    arguments, overrides = parser.parse_known_args()
    folders = Folders(arguments.root.resolve())
    found = tasks(folders, overrides)
    if not found:
        parser.error(f"{folders.root}: no case in it is whole; run benchmarks.closed_loop.generate first")
    if arguments.cases:
        if strange := sorted(set(arguments.cases) - {task.name for task in found}):
            parser.error(f"--cases: no such case: {', '.join(strange)}; overrides go before --cases")
        found = [task for task in found if task.name in arguments.cases]
    waiting = [task for task in found if not is_solved(task, arguments.again)][: arguments.limit]

    def solve(task: Task) -> Task:
        run(task, folders.seals, arguments.timeout, arguments.module)
        examine_solution(folders, task)
        return task

    with sealed(folders.seals), ThreadPoolExecutor(arguments.workers) as pool:
        for number, task in enumerate(pool.map(solve, waiting), start=1):
            result = (task.solution / RUN_FILE).read_text().strip()
            print(f"{number} of {len(waiting)}: {task.name} {result}", file=sys.stderr, flush=True)
    for task in found:  # of an earlier sitting that was ended in between
        if is_solved(task, again=False):
            examine_solution(folders, task)


if __name__ == "__main__":
    main()
