"""The errors of any saved model on any logs; where the logs hold targets, reaching, the delays and what safety did."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.deployment.graph_logs.graph_topics import GraphRecord, read_graph_topics
from pipeline.deployment.graph_logs.seen_in_logs import delay_samples, delays_seen, safety_events, safety_seen
from pipeline.dynamics.evaluation.errors import Predictor, prediction_errors
from pipeline.effects.store import load_predictor
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.messages.raw_log import RawLog
from pipeline.logs.telling import cautions
from pipeline.logs.trajectories import LogTrajectories, make_trajectories
from pipeline.machine.kinematics import load_arm
from pipeline.machine.specification import MachineSpecification
from pipeline.reaching.logged_trials import logged_trials, reaching_summary


def evaluate_logs(
    model: Path,
    logs: Path,
    machine: MachineSpecification,
    machine_directory: Path,
    ingest: IngestConfig,
    loop_tracker: LoopTrackerConfig,
    maximum_ticks: int,
    log: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Evaluate a saved model, with its effects, on logs (contract, section 3).

    Args:
        model: Folder of the model.
        logs: A log, or a folder of them.
        machine: Of model and logs.
        machine_directory: Folder of the machine's file.
        ingest: How logs are conditioned.
        loop_tracker: Of their velocities.
        maximum_ticks: Of a reaching trial.
        log: Called with one sentence per log that is not sound.

    Raises:
        InputError: The model is of another machine, or a log cannot be read.
    """
    predictor = load_predictor(model, machine=machine)
    entries = find_logs(logs)
    raw = [read_log(entry, machine, None, ingest.maximum_gap_s) for entry in entries]
    conditioned = [make_trajectories(one, machine, ingest, loop_tracker) for one in raw]
    for caution in cautions(conditioned):
        log(caution)
    evaluation = evaluate_model(predictor, conditioned, machine, str(logs))
    reaching = evaluate_reaching(conditioned, machine, machine_directory, maximum_ticks)
    if reaching is not None:
        evaluation["reaching"] = reaching
    if any(one.targets is not None for one in raw):
        evaluation |= evaluate_deployment(raw, [read_graph_topics(entry) for entry in entries])
    return evaluation


def evaluate_model(
    predictor: Predictor, logs: list[LogTrajectories], machine: MachineSpecification, place: str = "logs"
) -> dict[str, Any]:
    """One-step and open-loop errors over all logs, which are from `place`, per joint in rad or m."""
    trajectories = [trajectory for log in logs for trajectory in log.trajectories]
    errors = prediction_errors(predictor, trajectories, place)

    def by_joint(values: np.ndarray) -> dict[str, float]:
        return dict(zip(machine.joint_names, values.tolist(), strict=True))

    return {
        "one_step_rmse": by_joint(errors.one_step_rmse),
        "open_loop_rmse_80": by_joint(errors.open_loop_rmse_80),
        "n_windows": errors.n_windows,
        "n_steps": errors.n_steps,
    }


def evaluate_reaching(
    logs: list[LogTrajectories],
    machine: MachineSpecification,
    machine_directory: Path,
    maximum_ticks: int,
) -> dict[str, Any] | None:
    """Metrics of the trials in the logs; None where there are none, or the machine's arm is not described."""
    trials = [
        trial
        for log in logs
        if log.targets is not None
        for trial in logged_trials(log.trajectories, log.targets, maximum_ticks)
    ]
    if not trials:
        return None
    if machine.arm is None or machine.workspace is None:
        print(
            f"evaluate_logs: the logs hold {len(trials)} target poses, but conf/machine/{machine.name}.yaml has "
            "no section arm or workspace; reaching is not evaluated"
        )
        return None
    return reaching_summary(trials, machine, load_arm(machine, machine_directory))


def evaluate_deployment(logs: list[RawLog], records: list[GraphRecord]) -> dict[str, Any]:
    """Delays that were seen, and where the graph recorded itself what safety did; over the logs with targets."""
    pairs = [(log, record) for log, record in zip(logs, records, strict=True) if log.targets is not None]
    samples = [delay_samples(log, record) for log, record in pairs]
    found: dict[str, Any] = {"delays": delays_seen(samples, [record for _, record in pairs])}
    said = [safety_events(log.name, log, record) for log, record in pairs if any(record)]
    if said:
        found["safety"] = safety_seen(said)
        stops = [event for event in found["safety"]["events"] if event["who"] == "control_supervisor"]
        for stop in stops:
            print(
                f"emergency stop after {stop['t']:.2f} s of {stop['log']}: {stop['rule']}, {stop['detail']}"
            )
    return found
