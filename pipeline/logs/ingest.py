"""Turn a folder of logs into tuples and the quality report; logs run in parallel and resume."""

import functools
import hashlib
import json
import os
import shutil
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from pipeline.errors import InputError, counted
from pipeline.files.atomic import PARTIAL_SUFFIX, write_json
from pipeline.logs.conditioning.excitation import Excitation
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.formats.discovery.log_entry import LogEntry, LogFormat
from pipeline.logs.formats.opened_file import why_unreadable
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.messages.columns import ColumnStore, DiskStore
from pipeline.logs.messages.raw_log import Note, NoteKind
from pipeline.logs.quality import QualityReport, measure
from pipeline.logs.trajectories import grid_log, trajectory_sections
from pipeline.logs.tuples import SUFFIX, Trajectory, is_tuple_file, write_tuples
from pipeline.machine.specification import MachineSpecification, can_database

SCHEMA_VERSION = 5  # raise it when the tuples or the report of a log change
RECORD_SUFFIX = ".ingest.json"
SCRATCH_SUFFIX = ".scratch"
PARALLEL_FROM_BYTES = 1 << 29  # below, starting interpreters (2 s each) takes longer than it saves


@dataclass(frozen=True)
class Failure:
    """A log that could not be used, and why (one line)."""

    name: str
    reason: str


@dataclass
class IngestSummary:
    """Outcome of ingesting a folder of logs.

    Attributes:
        reports: Quality of each log that yielded tuples, by name.
        failures: Logs that could not be used.
        n_skipped: Logs whose tuples were up to date.
    """

    reports: list[QualityReport] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    n_skipped: int = 0

    def metrics(self) -> dict[str, float | int | None]:
        """Return flat, deterministic metrics: totals, then those of each log, prefixed by its name."""
        totals = {
            "n_logs": len(self.reports) + len(self.failures),
            "n_failed": len(self.failures),
            **{
                key: sum(report.metrics[key] or 0 for report in self.reports)
                for key in ("duration_s", "n_trajectories", "n_rows", "n_validation_rows")
            },
        }
        each = {
            f"{report.name}/{key}": value for report in self.reports for key, value in report.metrics.items()
        }
        return {**totals, **each}

    def raise_if_failed(self) -> None:
        """Raise an `InputError` with one line that names every log that failed."""
        if self.failures:
            total = len(self.reports) + len(self.failures)
            reasons = "; ".join(failure.reason for failure in self.failures)
            raise InputError(f"{len(self.failures)} of {counted(total, 'log')} failed: {reasons}")


def ingest(
    machine: MachineSpecification,
    logs_directory: Path,
    output_directory: Path,
    config: IngestConfig,
    loop_tracker: LoopTrackerConfig,
    *,
    allow_empty: bool = False,
    n_processes: int | None = None,
) -> IngestSummary:
    """Turn every log of a folder into tuples.

    Each log becomes `<name>.parquet` and a record of its measurements. A log whose record has the same bytes, machine
    and configuration is not read again. Outputs of removed logs are deleted. A log that fails does not stop the others.

    Args:
        logs_directory: Folder of logs, or one log.
        output_directory: Folder of tuples and records.
        config: Section `ingest`.
        loop_tracker: Section `control.loop_tracker`.
        allow_empty: Whether a folder without logs is allowed.
        n_processes: Number of logs read in parallel; by default the number of cores.

    Raises:
        InputError: The folder holds no logs (unless allowed), or the output cannot be written.
    """
    entries = _find(logs_directory, allow_empty)
    _refuse_overwriting(entries, logs_directory, output_directory)
    try:
        output_directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{output_directory}: cannot be made ({error.strerror}); name another output"
        ) from error
    settings = _Settings(machine, config, loop_tracker, output_directory)
    summary = IngestSummary()
    results = dict(_run(entries, settings, n_processes or os.cpu_count() or 1))
    for entry in entries:
        outcome = results[entry.name]
        if isinstance(outcome, Failure):
            summary.failures.append(outcome)
        else:
            report, skipped = outcome
            summary.reports.append(report)
            summary.n_skipped += skipped
    _remove_stale(output_directory, {report.name for report in summary.reports})
    return summary


def read_summary(directory: Path) -> IngestSummary:
    """What became of the logs whose tuples are in the folder, by the records beside them; logs that failed have none.

    Raises:
        InputError: A record cannot be read.
    """
    reports = []
    for path in directory.glob(f"*{RECORD_SUFFIX}"):
        try:
            reports.append(_report(json.loads(path.read_text(encoding="utf-8"))))
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path}: is not what ingest writes ({error}); run ingest again") from error
    return IngestSummary(sorted(reports, key=lambda report: report.name))


def write_metrics(summary: IngestSummary, path: Path) -> None:
    """Write the flat metrics as JSON."""
    write_json(path, summary.metrics())


@dataclass(frozen=True)
class _Settings:
    machine: MachineSpecification
    config: IngestConfig
    loop_tracker: LoopTrackerConfig
    output: Path


_Outcome = tuple[QualityReport, bool] | Failure


def _find(directory: Path, allow_empty: bool) -> list[LogEntry]:
    if allow_empty and (not directory.exists() or not any(directory.iterdir())):
        return []
    return find_logs(directory)


def _refuse_overwriting(entries: list[LogEntry], logs_directory: Path, output_directory: Path) -> None:
    """Check that no log lies where tuples are written or removed.

    Logs may lie in subfolders of the output: only files directly in the output are overwritten or removed.

    Raises:
        InputError: The output is the folder of the logs, or would overwrite one.
    """
    # unlike `resolve`, realpath accepts link loops
    output, logs = (Path(os.path.realpath(path)) for path in (output_directory, logs_directory))
    if output == logs:
        raise InputError(f"{output_directory}: is the folder of the logs; name another folder for the output")
    for entry in entries:
        if any(_would_be_lost(path, output) for path in (entry.path, *entry.files)):
            raise InputError(
                f"{entry.path}: lies where the output {output_directory} has its tuples; move the logs into a folder "
                "of their own, or name another output"
            )


def _would_be_lost(path: Path, output: Path) -> bool:
    """Whether the output would overwrite or remove a file, directly or through a link."""
    for place in (Path(os.path.realpath(path.parent)) / path.name, Path(os.path.realpath(path))):
        if place.parent == output and place.suffix == SUFFIX:
            return True
        if place.is_relative_to(output) and place.relative_to(output).parts[0].endswith(SCRATCH_SUFFIX):
            return True
    return False


def _run(entries: list[LogEntry], settings: _Settings, n_processes: int) -> Iterator[tuple[str, _Outcome]]:
    n_bytes = sum(_size(path) for entry in entries for path in entry.files)
    n_processes = min(n_processes, len(entries))
    if n_processes <= 1 or n_bytes < PARALLEL_FROM_BYTES:
        for entry in entries:
            yield entry.name, _ingest_one(entry, settings)
        return
    with ProcessPoolExecutor(n_processes, mp_context=get_context("spawn")) as pool:
        futures = {pool.submit(_ingest_one, entry, settings): entry for entry in entries}
        for future in as_completed(futures):
            entry = futures[future]
            try:
                yield entry.name, future.result()
            except BrokenProcessPool:
                yield (
                    entry.name,
                    Failure(entry.name, f"{entry.path}: the process that read it was killed; read it alone"),
                )


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:  # reported when the log is read
        return 0


def _ingest_one(entry: LogEntry, settings: _Settings) -> _Outcome:
    """Read one log and write its tuples and its record, unless they are up to date."""
    record_path = settings.output / f"{entry.name}{RECORD_SUFFIX}"
    tuples_path = settings.output / f"{entry.name}{SUFFIX}"
    try:
        fingerprint = _fingerprint(entry, settings)
        known = _read_record(record_path, fingerprint, tuples_path)
        if known is not None:
            return known, True
        with DiskStore(settings.output / f".{entry.name}{SCRATCH_SUFFIX}") as store:
            report = _convert(entry, settings, store, tuples_path)
        try:
            _write_record(record_path, fingerprint, tuples_path, report)
        except InputError:
            tuples_path.unlink(missing_ok=True)  # their record is missing
            raise
        return report, False
    except InputError as error:
        return Failure(entry.name, str(error))
    except OSError as error:
        return Failure(
            entry.name, f"{error.filename or entry.path}: {error.strerror or error}; check path and disk"
        )
    except MemoryError:
        return Failure(entry.name, f"{entry.path}: does not fit into memory; split the bag")


def _convert(entry: LogEntry, settings: _Settings, store: ColumnStore, tuples_path: Path) -> QualityReport:
    """Write one log's tuples section by section, and measure the log in the same pass."""
    machine, config = settings.machine, settings.config
    raw = read_log(entry, machine, store, config.maximum_gap_s)
    gridded = grid_log(raw, machine, config, store)
    excitation = Excitation(machine, config.frozen_after_s)
    n_validation_rows = 0

    def measured() -> Iterator[Trajectory]:
        nonlocal n_validation_rows
        for section in trajectory_sections(gridded, machine, config, settings.loop_tracker):
            excitation.add(section)
            n_validation_rows += int(section.is_validation.sum())
            yield section

    write_tuples(tuples_path, machine, measured())
    excitation.end_trajectory()
    return measure(raw, gridded, excitation, n_validation_rows, machine, config)


def _fingerprint(entry: LogEntry, settings: _Settings) -> str:
    """Return a digest of everything that the tuples and the record depend on."""
    digest = hashlib.sha256()
    described = [SCHEMA_VERSION, entry.name, entry.format, [path.name for path in entry.files]]
    described += [[note.text for note in entry.notes], entry.message_count]
    sections = [asdict(settings.machine), asdict(settings.config), asdict(settings.loop_tracker)]
    digest.update(json.dumps([*described, *sections]).encode())
    databases = [can_database(settings.machine)] if entry.format is LogFormat.can else []
    for path in [*entry.files, *filter(Path.exists, databases)]:
        try:
            if (reason := why_unreadable(path)) is not None:
                digest.update(reason.encode())  # opening a named pipe would block
                continue
            if entry.part is not None:  # the file holds other logs, too
                status = path.stat()
                digest.update(_shared_digest(path, status.st_size, status.st_mtime_ns).encode())
            else:
                digest.update(_file_digest(path).encode())
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror}); check its permissions") from error
    return digest.hexdigest()


def _write_record(path: Path, fingerprint: str, tuples_path: Path, report: QualityReport) -> None:
    record = {"fingerprint": fingerprint, "tuples": _file_digest(tuples_path), "report": asdict(report)}
    write_json(path, record)


def _read_record(path: Path, fingerprint: str, tuples_path: Path) -> QualityReport | None:
    """Return the report of an earlier run if its input is the same and its tuples are unchanged."""
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        if record["fingerprint"] != fingerprint or record["tuples"] != _file_digest(tuples_path):
            return None
        return _report(record)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _report(record: dict[str, Any]) -> QualityReport:
    report = record["report"]
    notes = [Note(**{**note, "kind": NoteKind(note["kind"])}) for note in report["notes"]]
    return QualityReport(report["name"], report["metrics"], notes, report["findings"])


@functools.lru_cache(maxsize=16)
def _shared_digest(path: Path, _size: int, _mtime_ns: int) -> str:
    return _file_digest(path)


def _file_digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _remove_stale(directory: Path, names: Iterable[str]) -> None:
    """Remove tuples and records of logs that are gone or fail now, and files of killed runs."""
    kept = set(names)
    for record in directory.glob(f"*{RECORD_SUFFIX}"):
        name = record.name.removesuffix(RECORD_SUFFIX)
        if name not in kept:
            (directory / f"{name}{SUFFIX}").unlink(missing_ok=True)
            record.unlink()
    for path in directory.glob(f"*{SUFFIX}"):  # killed before its record was written
        if (
            not path.name.startswith(".")
            and path.name.removesuffix(SUFFIX) not in kept
            and is_tuple_file(path)
        ):
            path.unlink()
    for scratch in directory.glob(f".*{SCRATCH_SUFFIX}"):
        shutil.rmtree(scratch, ignore_errors=True)
    for partial in directory.glob(f".*{PARTIAL_SUFFIX}"):
        if not partial.is_dir():  # a folder belongs to a bag that is being recorded here
            partial.unlink(missing_ok=True)
