"""One look at a machine: new sessions are added to the state, and all are judged."""

import hashlib
from collections.abc import Callable
from typing import Any

import numpy as np

from pipeline.discrepancy.unusable_logs import UnusableLogs
from pipeline.errors import InputError
from pipeline.files.atomic import write_json
from pipeline.logs.formats.discovery.discover import find_logs, is_empty_folder
from pipeline.logs.formats.discovery.log_entry import LogEntry
from pipeline.watch.cause import cause_of
from pipeline.watch.course import State, follow
from pipeline.watch.document import DOCUMENT, document_of
from pipeline.watch.log_identity import content_of, files_of
from pipeline.watch.nominal_sessions import (
    LearningSettings,
    NominalSessions,
    learn_nominal,
    load_nominal,
)
from pipeline.watch.session_store import SessionRecord, SessionStore, in_order, listed
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
    nominal = _nominal(inputs, settings, log)
    store = SessionStore(inputs.state)
    if inputs.baseline_ns is not None:
        store.begin_baseline(inputs.baseline_ns)
    not_counted = _add_new(store, nominal, inputs, settings, log)
    records, left_out = _counted(store, nominal)
    not_counted += left_out
    machine, config = settings.machine, settings.watch
    n_joint, n_statistic = nominal.rows.statistics.shape[1:]
    values = np.array([of.values for of in records]).reshape(len(records), n_joint, n_statistic)
    begins_ns = np.array([of.begin_ns for of in records], np.int64)
    baselines = [int(np.searchsorted(begins_ns, stamp)) for stamp in store.baselines()]
    course = follow(nominal.rows.statistics, values, baselines, config)
    joints = list(machine.joint_names)
    document = document_of(machine.name, joints, records, course, 1.0 / config.false_alarms)
    if document["findings"] and document["state"] == State.changed:
        since = records[course.changes[-1].onset.first :]
        document["findings"][-1]["cause"] = cause_of(since, inputs, settings, log)
    document |= {"nominal_sessions": len(nominal.rows.contents), "least_nominal": config.least_nominal}
    document["not_counted"] = [{"name": name, "why": why} for name, why in not_counted]
    write_json(inputs.output / DOCUMENT, document, allow_nan=False)
    return document


def _nominal(inputs: WatchInputs, settings: WatchSettings, log: Log) -> NominalSessions:
    entries = find_logs(inputs.nominal)
    learning = LearningSettings(settings.machine, settings.close_loop, settings.identify)
    stated = [line for entry in entries for line in files_of(entry)]
    files = hashlib.sha256("\n".join([learning.key(), *stated]).encode()).hexdigest()
    known = load_nominal(inputs.state, files, learning)
    if known is not None:
        return known
    sessions = [read_session(entry, settings).trajectories for entry in entries]
    try:
        return learn_nominal(inputs.state, files, sessions, learning, log)
    except UnusableLogs as error:
        raise InputError(f"nominal={inputs.nominal}: {error.why}") from None


def _add_new(
    store: SessionStore, nominal: NominalSessions, inputs: WatchInputs, settings: WatchSettings, log: Log
) -> list[tuple[str, str]]:
    """Names of logs that cannot be read, and why."""
    unreadable = []
    entries = [] if is_empty_folder(inputs.sessions) else find_logs(inputs.sessions)
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
    begin, end = trajectories[0].stamp_ns[0], trajectories[-1].stamp_ns[-1]
    (values,) = nominal.statistics_of([trajectories])
    return SessionRecord(
        content=content_of(trajectories),
        name=entry.name,
        path=str(entry.path.absolute()),
        files=[files],
        begin_ns=int(begin),
        end_ns=int(end),
        known_as=nominal.key,
        statistics=listed(values),
    )


def _counted(
    store: SessionStore, nominal: NominalSessions
) -> tuple[list[SessionRecord], list[tuple[str, str]]]:
    """Sessions in order, and those that do not count, with the reason."""
    usable, left_out = [], []
    for record in store.records.values():
        if record.content in nominal.rows.contents:
            left_out.append((record.name, "it is one of the nominal sessions"))
        elif record.known_as != nominal.key:
            left_out.append(
                (record.name, "its log is gone, and the nominal sessions or settings are others now")
            )
        else:
            usable.append(record)
    ordered, parts = in_order(usable)
    return ordered, left_out + [
        (name, f"its times overlap {whole}, which is longer") for name, whole in parts
    ]
