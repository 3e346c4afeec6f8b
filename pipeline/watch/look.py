"""One look at a machine: new sessions are added to the state, and all are judged."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from pipeline.discrepancy.unusable_logs import UnusableLogs
from pipeline.effects.store import load_dynamics
from pipeline.errors import InputError
from pipeline.files.atomic import write_json
from pipeline.logs.formats.discovery.discover import find_logs, is_empty_folder
from pipeline.logs.formats.discovery.log_entry import LogEntry
from pipeline.watch.cause import cause_of
from pipeline.watch.course import State
from pipeline.watch.document import DOCUMENT, document_of
from pipeline.watch.judgement import judge, record_of
from pipeline.watch.log_identity import files_of
from pipeline.watch.nominal_sessions import NominalSessions, learn_nominal, load_nominal
from pipeline.watch.session_store import SessionRecord, SessionStore
from pipeline.watch.watch_inputs import WatchInputs, WatchSettings, read_session

Log = Callable[[str], None]


def look(inputs: WatchInputs, settings: WatchSettings, log: Log = lambda _: None) -> dict[str, Any]:
    """Add the new sessions, judge all, seek the cause of a change; write `watch.json`.

    Args:
        inputs: Paths.
        settings: How.
        log: Called with one sentence per event.

    Returns:
        What `watch.json` holds.

    Raises:
        InputError: Nominal logs, the model or the state cannot be used, or a file cannot be written. A session that
            cannot be read is told in the document.
    """
    if inputs.model is not None:
        load_dynamics(inputs.model, settings.machine)  # its mistakes are told before the work
    entries = [] if is_empty_folder(inputs.sessions) else find_logs(inputs.sessions)
    nominal = _nominal(inputs, settings, log)
    store = SessionStore(inputs.state)
    if inputs.baseline_ns is not None:
        store.begin_baseline(inputs.baseline_ns)
    not_counted = _add_new(entries, store, nominal, settings, log)
    records, course, left_out = judge(store, nominal, settings.watch)
    not_counted += left_out
    machine, config = settings.machine, settings.watch
    joints = list(machine.joint_names)
    document = document_of(machine.name, joints, records, course, 1.0 / config.false_alarms)
    document |= {"nominal_sessions": len(nominal.rows.contents), "least_nominal": config.least_nominal}
    document["not_counted"] = [{"name": name, "why": why} for name, why in not_counted]
    write_json(inputs.output / DOCUMENT, document, allow_nan=False)  # whatever comes of its cause
    if document["findings"] and document["state"] == State.changed:
        since = records[course.changes[-1].onset.first :]
        document["findings"][-1]["cause"] = cause_of(since, inputs, settings, log)
        write_json(inputs.output / DOCUMENT, document, allow_nan=False)
    return document


def _nominal(inputs: WatchInputs, settings: WatchSettings, log: Log) -> NominalSessions:
    entries = find_logs(inputs.nominal)
    learning = settings.learning
    stated = [line for entry in entries for line in files_of(entry)]
    files = hashlib.sha256("\n".join(stated).encode()).hexdigest()
    known = load_nominal(inputs.state, learning, files)
    if known is not None:
        return known
    sessions = [read_session(entry, settings).trajectories for entry in entries]
    try:
        return learn_nominal(inputs.state, files, sessions, learning, log)
    except UnusableLogs as error:
        raise InputError(f"nominal={inputs.nominal}: {error.why}") from None


def _add_new(
    entries: Sequence[LogEntry],
    store: SessionStore,
    nominal: NominalSessions,
    settings: WatchSettings,
    log: Log,
) -> list[tuple[str, str]]:
    """Names of logs that cannot be read, and why."""
    unreadable = []
    current = [files for of in store.records.values() if of.known_as == nominal.key for files in of.files]
    for entry in entries:
        if files_of(entry) in current:
            continue
        try:
            record = _judged(entry, nominal, settings)
        except InputError as error:
            log(f"does not count: {error}")
            unreadable.append((entry.name, str(error)))
            continue
        store.add(record)
        log(f"added {entry.name}")
    return unreadable


def _judged(entry: LogEntry, nominal: NominalSessions, settings: WatchSettings) -> SessionRecord:
    files = files_of(entry)  # as they are before they are read: what is written meanwhile is read next time
    trajectories = read_session(entry, settings).trajectories
    (values,) = nominal.statistics_of([trajectories])
    record = record_of(trajectories, values, nominal.key, entry.name)
    return replace(record, path=str(entry.path.absolute()), files=[files])
