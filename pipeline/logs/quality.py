"""What is measured about every log: rates, jitter, gaps, clocks, commands, delays, and what the data lack."""

from dataclasses import dataclass

import numpy as np

from pipeline.logs.excitation import apparent_delay_s, command_statistics, findings, frozen_stretches
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.raw_log import NANOSECONDS, Note, RawLog
from pipeline.logs.trajectories import LogTrajectories
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification

SIGNIFICANT_DIGITS = 6


@dataclass(frozen=True)
class QualityReport:
    """What was measured about one log.

    Attributes:
        name: The log.
        metrics: Flat: names with `/`, numbers or None where there was nothing to measure. Deterministic.
        notes: Everything lost, left out, changed or odd.
        findings: What later stages will find missing, one sentence each.
    """

    name: str
    metrics: dict[str, float | int | None]
    notes: list[Note]
    findings: list[str]


def measure(
    raw: RawLog, result: LogTrajectories, machine: MachineSpecification, config: IngestConfig
) -> QualityReport:
    """Measure one log and its trajectories."""
    trajectories = result.trajectories
    clock = result.conditioned.clock
    duration_ns = max(raw.joint_log_time_ns.max(), raw.command_log_time_ns.max()) - min(
        raw.joint_log_time_ns.min(), raw.command_log_time_ns.min()
    )
    metrics: dict[str, float | int | None] = {
        "duration_s": float(duration_ns / NANOSECONDS),
        "n_trajectories": len(trajectories),
        "n_rows": sum(len(trajectory) for trajectory in trajectories),
        "n_validation_rows": sum(int(trajectory.is_validation.sum()) for trajectory in trajectories),
        "n_targets": 0 if raw.targets is None else len(raw.targets.log_time_ns),
    }
    sampled_ns = np.sort(raw.joint_stamp_ns if not clock.reason else raw.joint_log_time_ns)
    streams = {"joint_states": sampled_ns, "commands": np.sort(raw.command_log_time_ns)}
    for stream, time_ns in streams.items():
        metrics |= {
            f"{stream}/{key}": value for key, value in sampling(time_ns, config.maximum_gap_s).items()
        }
    metrics |= {
        "clock/uses_log_time": int(bool(clock.reason)),
        "clock/offset_s": clock.offset_s,
        "clock/offset_p01_s": clock.offset_p01_s,
        "clock/offset_p99_s": clock.offset_p99_s,
        "clock/drift_ppm": clock.drift_ppm,
    }
    for kind in sorted({note.kind for note in result.notes}):
        metrics[f"notes/{kind}"] = sum(note.count for note in result.notes if note.kind == kind)
    for number, joint in enumerate(machine.joint_names):
        values = {**_range(trajectories, number), **command_statistics(trajectories, number, machine.dt_s)}
        values["frozen"] = frozen_stretches(trajectories, number, machine, config.frozen_after_s)
        values["apparent_delay_s"], values["n_delays"] = apparent_delay_s(trajectories, number, machine)
        metrics |= {f"{joint}/{key}": value for key, value in values.items()}
    rounded = {key: _rounded(value) for key, value in metrics.items()}
    return QualityReport(raw.name, rounded, list(result.notes), findings(trajectories, machine))


def sampling(time_ns: np.ndarray, maximum_gap_s: float) -> dict[str, float | int | None]:
    """Measure the intervals of a stream of samples with ascending times, shape (N,), int64 ns."""
    values: dict[str, float | int | None] = {"n": len(time_ns)}
    if len(time_ns) < 2:
        return {
            **values,
            "rate_hz": None,
            "interval_s": None,
            "jitter_s": None,
            "longest_gap_s": None,
            "n_gaps": 0,
        }
    interval_s = np.diff(time_ns) / NANOSECONDS
    median = float(np.median(interval_s))
    return {
        **values,
        "rate_hz": 1.0 / median if median > 0 else None,
        "interval_s": median,
        # Half the distance of the 16th and 84th percentile: the standard deviation without the gaps' weight.
        "jitter_s": float(np.diff(np.percentile(interval_s, [16, 84]))[0] / 2),
        "longest_gap_s": float(interval_s.max()),
        "n_gaps": int((interval_s > maximum_gap_s).sum()),
    }


def _range(trajectories: list[Trajectory], joint: int) -> dict[str, float | int | None]:
    q = np.concatenate([trajectory.q[:, joint] for trajectory in trajectories])
    qd = np.concatenate([trajectory.qd[:, joint] for trajectory in trajectories])
    return {
        "position_min": float(q.min()),
        "position_max": float(q.max()),
        "speed_max": float(np.abs(qd).max()),
    }


def _rounded(value: float | int | None) -> float | int | None:
    if isinstance(value, float):
        return float(f"{value:.{SIGNIFICANT_DIGITS}g}") if np.isfinite(value) else None
    return value
