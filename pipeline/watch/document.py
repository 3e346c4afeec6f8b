"""watch.json: what a look says."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np

from pipeline.watch.change import trend_of
from pipeline.watch.course import Change, Course, State
from pipeline.watch.session_store import SessionRecord
from pipeline.watch.statistics import STATISTICS

DOCUMENT = "watch.json"


def document_of(
    machine: str, joints: Sequence[str], records: Sequence[SessionRecord], course: Course, alarm_at: float
) -> dict[str, Any]:
    """All but causes, and sessions that do not count.

    Args:
        machine: Its name.
        joints: Names in order.
        records: Sessions in order.
        course: Theirs.
        alarm_at: E-value from which on a machine is told as changed.
    """
    sessions = [_session(index, record, joints, course) for index, record in enumerate(records)]
    findings = [_finding(change, joints, records, course) for change in course.changes]
    is_changed = bool(findings) and findings[-1]["until"] is None
    latest = sessions[-1]["state"] if sessions else State.not_enough
    return {
        "machine": machine,
        "state": State.changed if is_changed else latest,
        "e_value": sessions[-1]["e_value"] if sessions else 1.0,
        "alarm_at": alarm_at,
        "sessions": sessions,
        "findings": findings,
    }


def metrics_of(session: Mapping[str, Any]) -> dict[str, float]:
    """Evidence of one of the document's sessions by dotted names."""
    by_joint = {f"e_value.{joint}": float(of["e_value"]) for joint, of in session["joints"].items()}
    return {"e_value": float(session["e_value"]), **by_joint}


def _session(index: int, record: SessionRecord, joints: Sequence[str], course: Course) -> dict[str, Any]:
    states = [str(state) for state in course.state[index]]
    state = next((of for of in (State.changed, State.healthy) if of in states), State.not_enough)
    return {
        "name": record.name,
        "begin": _time(record.begin_ns),
        "minutes": round((record.end_ns - record.begin_ns) / 60e9, 2),
        "is_baseline": bool(course.is_baseline[index]),
        "e_value": float(course.machine_e_value[index]),
        "state": str(state),
        "joints": {
            joint: {"e_value": float(course.e_value[index, j]), "state": states[j]}
            for j, joint in enumerate(joints)
        },
    }


def _finding(
    change: Change, joints: Sequence[str], records: Sequence[SessionRecord], course: Course
) -> dict[str, Any]:
    leading, onset = change.leading, change.onset
    statistic = STATISTICS[leading.statistic]
    end = len(records) if change.end is None else change.end
    values = np.array([of.values[leading.joint, leading.statistic] for of in records[onset.first : end]])
    trend = trend_of(values, leading.mean, statistic.limit)
    changed = (course.state[change.alarm : end] == State.changed).any(axis=0)
    return {
        "joints": [joint for j, joint in enumerate(joints) if changed[j]],
        "alarm": records[change.alarm].name,
        "onset": {
            "session": records[onset.first].name,
            "interval": [records[index].name for index in onset.interval],
            "course": "ramp" if onset.is_ramp else "step",
        },
        "until": None if change.end is None else records[change.end].name,
        "size": {
            "statistic": statistic.name,
            "joint": joints[leading.joint],
            "unit": statistic.unit,
            "before": leading.mean,
            "deviation": leading.deviation,
            "by_session": [None if np.isnan(value) else float(value) for value in values],
        },
        "trend": None
        if trend is None
        else {
            "per_session": trend.per_session,
            "ci95": list(trend.ci95),
            "latest": trend.latest,
            "limit": statistic.limit,
            "reaches_limit_in_sessions": None if trend.reaches is None else list(trend.reaches),
        },
        "cause": None,
    }


def _time(stamp_ns: int) -> str:
    return datetime.fromtimestamp(stamp_ns // 1_000_000_000, UTC).isoformat()
