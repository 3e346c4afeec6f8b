"""What comes of a damaged log: the whole ingest is run on it, in this process or in one that the case needs.

`python -m tests.logs.damage.outcome` is such a process: it takes log, output, and whether to read only, as JSON lines,
and answers each with an outcome.
"""

import contextlib
import ctypes
import dataclasses
import json
import os
import resource
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.configuration.load import load_machine, load_section
from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.ingest import ingest
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.messages.columns import DiskStore
from pipeline.logs.messages.raw_log import Note, NoteKind
from tests.logs.conftest import REPOSITORY
from tests.logs.damage.case import REFUSED, DamageCase, Damaged, Where

DEADLINE_S = 15
FUSE_BYTES = 4 << 30  # of memory that is the process's own; files may be mapped beyond it
FULL_DISK_FILE_BYTES = 4096
PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH = 24, 1, 2
TOLD = (NoteKind.damage, NoteKind.left_out, NoteKind.attention)
OF_ANY_LOG = "joint samples before the first command"


class OverdueError(BaseException):
    """Something takes too long. Nothing that is tested may catch this, so it is no `Exception`."""


@dataclass(frozen=True)
class Outcome:
    """What came of a log.

    Attributes:
        recovered: Joint samples and commands that were read.
        lines: What the user is told, without what every undamaged log is told too.
        status: The exit status that it leads to; 1 for a traceback.
        processor_s: Processor time that it took, of all threads: what else the machine does must not count.
        grown_bytes: By how much the process grew over what it needed before.
    """

    recovered: int
    lines: list[str]
    status: int
    processor_s: float
    grown_bytes: int


def outcome_of(path: Path, output: Path, only_read: bool = False) -> Outcome:
    """Run the ingest on a log, as the stage does, or its reading alone."""
    before, started = _peak_bytes(), time.process_time()
    recovered, lines, status = 0, [], 0
    try:
        with deadline(DEADLINE_S):
            recovered, told, failures = _read(path, output) if only_read else _ingest(path, output)
            lines = [note.text for note in told if note.kind in TOLD and note.text != OF_ANY_LOG] + failures
            status = REFUSED if failures else 0
    except InputError as error:
        lines, status = [str(error)], REFUSED
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # also polars' panics, which are no `Exception`
        place = traceback.extract_tb(error.__traceback__)[-1]
        lines, status = (
            [f"traceback: {type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"],
            1,
        )
    return Outcome(recovered, lines, status, time.process_time() - started, _peak_bytes() - before)


def _ingest(path: Path, output: Path) -> tuple[int, list[Note], list[str]]:
    config = load_section("ingest", IngestConfig)
    tracker = load_section("control.loop_tracker", LoopTrackerConfig)
    summary = ingest(load_machine("bobcat_e10"), path, output, config, tracker)
    streams = ("joint_states", "commands")
    recovered = sum(report.metrics[f"{stream}/n"] for report in summary.reports for stream in streams)
    notes = [note for report in summary.reports for note in report.notes]
    return recovered, notes, [failure.reason for failure in summary.failures]


def _read(path: Path, output: Path) -> tuple[int, list[Note], list[str]]:
    (entry,) = find_logs(path)
    with DiskStore(output) as store:
        raw = read_log(entry, load_machine("bobcat_e10"), store)
        return len(raw.q) + len(raw.command_log_time_ns), list(raw.notes), []


@contextlib.contextmanager
def deadline(seconds: int) -> Iterator[None]:
    """Raise `OverdueError` in what takes longer."""

    def ring(*_: object) -> None:
        raise OverdueError(f"over {seconds} s")

    earlier = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, earlier)


@contextlib.contextmanager
def full_disk() -> Iterator[None]:
    """The kernel refuses to let files grow, as it refuses on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (FULL_DISK_FILE_BYTES, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def outcomes(built: Sequence[tuple[DamageCase, Damaged, Path]]) -> list[Outcome]:
    """Run cases where they must be run; each is given with its output folder."""
    results: dict[int, Outcome] = {}
    for where in Where:
        rows = [number for number, (case, _, _) in enumerate(built) if case.where is where]
        if where in (Where.fused, Where.unprivileged):
            tasks = [(built[row][1].path, built[row][2], built[row][0].only_read) for row in rows]
            results |= dict(zip(rows, _outcomes_elsewhere(where, tasks), strict=True))
            continue
        for row in rows:
            with full_disk() if where is Where.full_disk else contextlib.nullcontext():
                results[row] = outcome_of(built[row][1].path, built[row][2])
    return [results[row] for row in range(len(built))]


def _outcomes_elsewhere(where: Where, tasks: list[tuple[Path, Path, bool]]) -> list[Outcome]:
    """Run several logs in one process of their own; in another one, if a log kills it."""
    found: list[Outcome] = []
    while len(found) < len(tasks):
        waiting = [[str(path), str(output), only_read] for path, output, only_read in tasks[len(found) :]]
        result = subprocess.run(
            [sys.executable, "-m", "tests.logs.damage.outcome"],
            input="".join(json.dumps(task) + "\n" for task in waiting),
            capture_output=True,
            text=True,
            cwd=REPOSITORY,
            preexec_fn={Where.fused: _limit_memory, Where.unprivileged: give_up_rights}[where],
            check=False,
        )
        found += [Outcome(**json.loads(line)) for line in result.stdout.splitlines()]
        if result.returncode:
            last_words = result.stderr.strip().splitlines()[-1:]
            found.append(Outcome(0, [f"the process died: {''.join(last_words)}"], result.returncode, 0.0, 0))
    return found


def give_up_rights() -> None:
    """Before exec: root keeps its name and loses the right to pass over permissions."""
    if os.geteuid() == 0:
        library = ctypes.CDLL(None, use_errno=True)
        for capability in (CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH):
            if library.prctl(PR_CAPBSET_DROP, capability, 0, 0, 0):
                raise OSError(ctypes.get_errno(), "prctl")


def _limit_memory() -> None:
    resource.setrlimit(resource.RLIMIT_DATA, (FUSE_BYTES, FUSE_BYTES))


def _peak_bytes() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def main() -> None:
    """Answer each line of standard input."""
    for line in sys.stdin:
        path, output, only_read = json.loads(line)
        result = outcome_of(Path(path), Path(output), only_read)
        print(json.dumps(dataclasses.asdict(result)), flush=True)


if __name__ == "__main__":
    main()
