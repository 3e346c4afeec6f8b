"""Measurements from a deployment's log besides the trials: delays, and interventions of the safety measures.

Delays are differences of stamps; with stamps of two clocks they include the clocks' offset. Any log has joint states
with two stamps and commands with one; the graph's own messages (`graph_topics`) supply the rest.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.deployment.component import NANOSECONDS
from pipeline.deployment.graph_logs.graph_topics import GraphRecord
from pipeline.deployment.messages import GoalOutcome, InterfaceRule, JointCommand
from pipeline.logs.messages.columns import as_array
from pipeline.logs.messages.raw_log import RawLog

QUANTILES = {"median": 0.5, "p99": 0.99, "p999": 0.999, "maximum": 1.0}
BY_SAFETY = (  # outcomes of goals that the server's safety measures ended
    GoalOutcome.left_workspace,
    GoalOutcome.oscillated,
    GoalOutcome.stopped,
    GoalOutcome.controller_failed,
)


def delay_samples(raw: RawLog, record: GraphRecord) -> dict[str, np.ndarray]:
    """Samples of every delay that one log contains, s; missing delays are absent.

    Returns:
        Samples by name, (n,) each:
        `joint_state_recording`: from the sampling of a joint state (its stamp) to its recording;
        `joint_state_interval`, `command_interval`: between two messages, by stamps and by recording;
        `state_age_at_command`: age of the newest joint state, by its stamp, at the recording of a command;
        `decision_age`: from a decision's joint state to the first sending of its command;
        `request_to_command`: from a server's request to the forwarded command.
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
    """Outcomes of goals in one log, and emergency stops with source, rule and time; for JSON.

    Args:
        name: name of the log.
        raw: the log; `t` of an event is seconds since its first joint state or command.
        record: the graph's own messages; not empty.
    """
    command_times, values = as_array(raw.command_log_time_ns), as_array(raw.command)
    begin_ns = min(int(as_array(raw.joint_log_time_ns)[0]), int(command_times[0]))
    events: list[dict[str, Any]] = [
        {
            "who": "control_interface" if stop.rule in list(InterfaceRule) else "control_supervisor",
            "rule": stop.rule,
            "detail": stop.detail,
            "time_ns": time_ns,
        }
        for time_ns, stop in record.stops
    ] + [
        {"who": "autonomous_server", "rule": str(result.outcome), "detail": "", "time_ns": time_ns}
        for time_ns, result in record.results
        if result.outcome in BY_SAFETY
    ]
    for event in events:
        event["log"] = name
        event["t"] = (event["time_ns"] - begin_ns) / NANOSECONDS
    is_stopped = np.zeros(len(command_times), bool)
    for time_ns, stop in record.stops:
        released = (t for t, release in record.releases if release.stop_ns >= stop.stamp_ns)
        is_stopped |= (command_times > time_ns) & (command_times <= min(released, default=command_times[-1]))
    return {
        "outcomes": dict(Counter(str(result.outcome) for _, result in record.results)),
        "events": sorted(events, key=lambda event: event["time_ns"]),
        "emergency_stops": len(record.stops),
        "commands_after_stop": int((np.any(values != 0, axis=1) & is_stopped).sum()),
    }


def safety_seen(of_logs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Safety over all logs: summed outcomes and counts, concatenated events."""
    outcomes: Counter[str] = Counter()
    for of_log in of_logs:
        outcomes.update(of_log["outcomes"])
    return {
        "outcomes": dict(sorted(outcomes.items())),
        "events": [event for of_log in of_logs for event in of_log["events"]],
        **{key: sum(of_log[key] for of_log in of_logs) for key in ("emergency_stops", "commands_after_stop")},
    }


def _decision_ages(requests: Sequence[JointCommand]) -> np.ndarray:
    """Time from observation to sending of each decision's first request; the end of a goal does not count."""
    ages, last = [], -1
    for request in requests:
        if request.observed_ns != last and not request.is_last:
            ages.append(request.stamp_ns - request.observed_ns)
        last = request.observed_ns
    return np.array(ages, np.int64)


def _passing_on(record: GraphRecord, commands: np.ndarray) -> np.ndarray:
    """Time from each request to its command.

    With equal numbers of commands and requests, the n-th command belongs to the n-th request. Otherwise messages were
    lost or sent by the interface itself, and a command belongs to the newest request: long delays then look shorter.
    """
    requests = np.array([time_ns for time_ns, _ in record.requests], np.int64)
    if not len(requests):
        return requests
    if len(requests) == len(commands):
        return commands - requests
    newest = np.searchsorted(requests, commands, side="right") - 1
    return (commands - requests[np.maximum(newest, 0)])[newest >= 0]


def _sequence_faults(record: GraphRecord) -> tuple[int, int]:
    """Number of requests missing between a server's first and last, and of requests out of order."""
    by_source: dict[str, list[int]] = {}
    for _, request in record.requests:
        by_source.setdefault(request.source, []).append(request.sequence)
    lost = sum(max(s) - min(s) + 1 - len(set(s)) for s in by_source.values())
    return lost, sum(int((np.diff(s) <= 0).sum()) for s in by_source.values())
