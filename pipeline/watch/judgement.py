"""Sessions of a state in order, each judged in the light of those before it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pipeline.logs.tuples import Trajectory
from pipeline.watch.course import Course, follow
from pipeline.watch.log_identity import content_of
from pipeline.watch.nominal_sessions import NominalSessions
from pipeline.watch.session_store import SessionRecord, SessionStore, in_order, listed
from pipeline.watch.settings import WatchConfig


class Judgement(NamedTuple):
    """What a state says.

    Attributes:
        records: Sessions that count, in order.
        course: Theirs.
        left_out: Names of those that do not count, and why.
    """

    records: list[SessionRecord]
    course: Course
    left_out: list[tuple[str, str]]


def judge(
    store: SessionStore, nominal: NominalSessions, config: WatchConfig, running: SessionRecord | None = None
) -> Judgement:
    """Judge all sessions.

    Args:
        store: Of the state.
        nominal: The nominal machine.
        config: Section `watch`.
        running: One more session, which is not in the state; in place of what the state has of the same content.

    Raises:
        InputError: The state is damaged.
    """
    every = store.records if running is None else store.records | {running.content: running}
    records, left_out = _counted(list(every.values()), nominal)
    shape = nominal.rows.statistics.shape[1:]
    values = np.array([of.values for of in records]).reshape(len(records), *shape)
    begins_ns = np.array([of.begin_ns for of in records], np.int64)
    baselines = [int(np.searchsorted(begins_ns, stamp)) for stamp in store.baselines()]
    course = follow(nominal.rows.statistics, values, baselines, config)
    return Judgement(records, course, left_out)


def record_of(
    trajectories: Sequence[Trajectory], values: np.ndarray, known_as: str, name: str
) -> SessionRecord:
    """A session that lies in no file yet.

    Args:
        trajectories: Its own, in order.
        values: (n_joint, n_statistic).
        known_as: Key of the nominal sessions.
        name: Of its log.
    """
    begin, end = trajectories[0].stamp_ns[0], trajectories[-1].stamp_ns[-1]
    return SessionRecord(
        content=content_of(trajectories),
        name=name,
        path="",
        files=[],
        begin_ns=int(begin),
        end_ns=int(end),
        known_as=known_as,
        statistics=listed(values),
    )


def _counted(
    every: Sequence[SessionRecord], nominal: NominalSessions
) -> tuple[list[SessionRecord], list[tuple[str, str]]]:
    """Sessions in order, and those that do not count, with the reason."""
    usable, left_out = [], []
    for record in every:
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
