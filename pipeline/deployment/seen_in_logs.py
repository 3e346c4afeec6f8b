"""What a log of a deployment tells beside the trials: delays that were seen, and what safety did.

Delays are differences of stamps: where two clocks made them, the clocks' offset is in them. Any log has joint states
with two stamps and commands with one; what the graph said of itself (`graph_topics`) tells the rest.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.deployment.component import NANOSECONDS
from pipeline.deployment.graph_topics import GraphRecord
from pipeline.deployment.messages import GoalOutcome, JointCommand
from pipeline.logs.messages.columns import as_array
from pipeline.logs.messages.raw_log import RawLog

QUANTILES = {"median": 0.5, "p99": 0.99, "p999": 0.999, "maximum": 1.0}
BY_SAFETY = (  # outcomes of a goal that a safety measure of the server ended
    GoalOutcome.left_workspace,
    GoalOutcome.oscillated,
    GoalOutcome.stopped,
    GoalOutcome.controller_failed,
)


def delay_samples(raw: RawLog, record: GraphRecord) -> dict[str, np.ndarray]:
    """Samples of every delay that one log tells, s; what it does not tell is absent.

    Returns:
        By name, (n,) each:
        `joint_state_recording`: from the sampling of a joint state (its stamp) to its recording;
        `joint_state_interval`, `command_interval`: between two of them, by their stamps and their recording;
        `state_age_at_command`: of the newest joint state, by its stamp, when a command was recorded;
        `decision_age`: from the joint state that a command was decided on to the command's first sending;
        `request_to_command`: from a server's request to the command that the interface passed on.
    """
    stamps, recorded, commands = map(
        as_array, (raw.joint_stamp_ns, raw.joint_log_time_ns, raw.command_log_time_ns)
    )
    stamped = stamps > 0
    times = np.sort(np.where(stamped, stamps, recorded))
    commands = np.sort(commands)
    newest = np.searchsorted(times, commands, side="right") - 1
    samples = {
        "joint_state_recording": (recorded - stamps)[stamped],
        "joint_state_interval": np.diff(times),
        "command_interval": np.diff(commands),
        "state_age_at_command": (commands - times[np.maximum(newest, 0)])[newest >= 0],
        "decision_age": _decision_ages([request for _, request in record.requests]),
        "request_to_command": _passing_on(record, commands),
    }
    return {name: values / NANOSECONDS for name, values in samples.items() if len(values)}


def delays_seen(samples: Sequence[dict[str, np.ndarray]], records: Sequence[GraphRecord]) -> dict[str, Any]:
    """Delays over all logs, s, for JSON: quantiles and numbers; and requests that were lost or came out of order."""
    names = dict.fromkeys(name for of_log in samples for name in of_log)
    seen: dict[str, Any] = {}
    for name in names:
        values = np.concatenate([of_log[name] for of_log in samples if name in of_log])
        seen[f"{name}_s"] = {key: float(np.quantile(values, q)) for key, q in QUANTILES.items()}
        seen[f"{name}_s"]["n"] = len(values)
    if any(record.requests for record in records):
        lost, disordered = np.sum([_sequence_faults(record) for record in records], axis=0)
        seen["requests"] = {
            "n": sum(len(record.requests) for record in records),
            "lost": int(lost),
            "out_of_order": int(disordered),
        }
    return seen


def safety_events(name: str, raw: RawLog, record: GraphRecord) -> dict[str, Any]:
    """How goals ended in one log, and who stopped the machine, by which rule, when; for JSON.

    Args:
        name: of the log.
        raw: the log; `t` of an event is seconds since its first joint state or command.
        record: what the graph said; not empty.
    """
    command_times, values = as_array(raw.command_log_time_ns), as_array(raw.command)
    begin_ns = min(int(as_array(raw.joint_log_time_ns)[0]), int(command_times[0]))
    events: list[dict[str, Any]] = [
        {"who": "control_supervisor", "rule": stop.rule, "detail": stop.detail, "time_ns": time_ns}
        for time_ns, stop in record.stops
    ] + [
        {"who": "autonomous_server", "rule": str(result.outcome), "detail": "", "time_ns": time_ns}
        for time_ns, result in record.results
        if result.outcome in BY_SAFETY
    ]
    for event in events:
        event["log"] = name
        event["t"] = (event["time_ns"] - begin_ns) / NANOSECONDS
    stopped_ns = record.stops[0][0] if record.stops else None
    moves = np.any(values != 0, axis=1)
    after = 0 if stopped_ns is None else int((moves & (command_times > stopped_ns)).sum())
    return {
        "outcomes": dict(Counter(str(result.outcome) for _, result in record.results)),
        "events": sorted(events, key=lambda event: event["time_ns"]),
        "emergency_stops": len(record.stops),
        "commands_after_stop": after,
    }


def safety_seen(of_logs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Safety over all logs: outcomes and counts summed, events one after the other."""
    outcomes: Counter[str] = Counter()
    for of_log in of_logs:
        outcomes.update(of_log["outcomes"])
    return {
        "outcomes": dict(sorted(outcomes.items())),
        "events": [event for of_log in of_logs for event in of_log["events"]],
        **{key: sum(of_log[key] for of_log in of_logs) for key in ("emergency_stops", "commands_after_stop")},
    }


def _decision_ages(requests: Sequence[JointCommand]) -> np.ndarray:
    """From observation to sending, of the first request of each decision; what stops a goal is no decision."""
    ages, last = [], -1
    for request in requests:
        if request.observed_ns != last and not request.is_last:
            ages.append(request.stamp_ns - request.observed_ns)
        last = request.observed_ns
    return np.array(ages, np.int64)


def _passing_on(record: GraphRecord, commands: np.ndarray) -> np.ndarray:
    """From each request to its command.

    Where there are as many commands as requests the n-th is the n-th's; else a command is the newest request's, as
    some were lost on the way or sent by the interface itself: a delay beyond a period then looks shorter.
    """
    requests = np.array([time_ns for time_ns, _ in record.requests], np.int64)
    if not len(requests):
        return requests
    if len(requests) == len(commands):
        return commands - requests
    newest = np.searchsorted(requests, commands, side="right") - 1
    return (commands - requests[np.maximum(newest, 0)])[newest >= 0]


def _sequence_faults(record: GraphRecord) -> tuple[int, int]:
    """Requests that are missing between a server's first and last, and such as came after a later one."""
    by_source: dict[str, list[int]] = {}
    for _, request in record.requests:
        by_source.setdefault(request.source, []).append(request.sequence)
    lost = sum(max(s) - min(s) + 1 - len(set(s)) for s in by_source.values())
    return lost, sum(int((np.diff(s) <= 0).sum()) for s in by_source.values())
