"""Quality of a log: rates, jitter, gaps, clocks, commands, delays, and gaps in the data."""

from dataclasses import dataclass

import numpy as np

from pipeline.errors import counted
from pipeline.logs.conditioning.excitation import Excitation, Figures
from pipeline.logs.conditioning.order_statistics import quantiles, widened
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.messages.columns import SECTION_ROWS, Column, extent, sections
from pipeline.logs.messages.raw_log import NANOSECONDS, Note, RawLog
from pipeline.logs.telling import losses, warnings
from pipeline.logs.trajectories import GriddedLog, channel_values
from pipeline.machine.specification import MachineSpecification

SIGNIFICANT_DIGITS = 6


@dataclass(frozen=True)
class QualityReport:
    """Measurements of one log.

    Attributes:
        name: The log.
        metrics: Flat names with `/`; numbers, or None if nothing could be measured. Deterministic.
        notes: Damage, losses, changes and irregularities.
        findings: What the data lack for later stages, one sentence each.
    """

    name: str
    metrics: dict[str, float | int | None]
    notes: list[Note]
    findings: list[str]

    @property
    def line(self) -> str:
        """One line for the terminal: rows, seconds, gaps, and of unsound logs what was lost and where, damage first."""
        keys = ("n_rows", "n_trajectories", "joint_states/n_gaps")
        n_rows, n_trajectories, n_gaps = (int(self.metrics[key] or 0) for key in keys)
        length = f"{counted(n_rows, 'row')}, {self.metrics['duration_s']:.0f} s"
        parts = [f"{length} in {n_trajectories} trajectories" if n_trajectories > 1 else length]
        if n_gaps:
            longest = self.metrics["joint_states/longest_gap_s"]
            parts.append(f"{counted(n_gaps, 'gap')} between joint samples, the longest of {longest:.3g} s")
        return f"{self.name}: {'; '.join([*parts, *losses(self.notes)])}"

    @property
    def warnings(self) -> list[str]:
        """What makes the rows probably wrong until the user acts."""
        return warnings(self.notes)


def measure(
    raw: RawLog,
    gridded: GriddedLog,
    excitation: Excitation,
    n_validation_rows: int,
    machine: MachineSpecification,
    config: IngestConfig,
) -> QualityReport:
    """Measure one log: as read, on the grid, and its trajectories' excitation."""
    clock = gridded.clock
    metrics: Figures = {
        "duration_s": (gridded.end_ns - gridded.start_ns) / NANOSECONDS,
        "n_trajectories": len(gridded.lengths),
        "n_rows": sum(gridded.lengths),
        "n_validation_rows": n_validation_rows,
        "n_targets": 0 if raw.targets is None else len(raw.targets.log_time_ns),
    }
    streams = {
        "joint_states": (raw.joint_log_time_ns, gridded.joint_intervals_ns),
        "commands": (raw.command_log_time_ns, gridded.command_intervals_ns),
    }
    for stream, (messages, intervals_ns) in streams.items():
        measured = {"n": len(messages), **sampling(intervals_ns, config.maximum_gap_s)}
        metrics |= {f"{stream}/{key}": value for key, value in measured.items()}
    metrics |= {
        "clock/uses_log_time": int(bool(clock.reason)),
        "clock/offset_s": clock.offset_s,
        "clock/offset_p01_s": clock.offset_p01_s,
        "clock/offset_p99_s": clock.offset_p99_s,
        "clock/drift_ppm": clock.drift_ppm,
    }
    metrics |= _channel_figures(raw, gridded, machine)
    for kind in sorted({note.kind for note in gridded.notes}):
        metrics[f"notes/{kind}"] = sum(note.count for note in gridded.notes if note.kind == kind)
    for number, joint in enumerate(machine.joint_names):
        values = {**excitation.position_range(number), **excitation.command_statistics(number)}
        values["frozen"] = excitation.frozen_stretches(number)
        values["apparent_delay_s"], values["n_delays"] = excitation.apparent_delay_s(number)
        metrics |= {f"{joint}/{key}": value for key, value in values.items()}
    rounded = {key: _rounded(value) for key, value in metrics.items()}
    return QualityReport(raw.name, rounded, list(gridded.notes), excitation.findings())


def _channel_figures(raw: RawLog, gridded: GriddedLog, machine: MachineSpecification) -> Figures:
    """Measure each channel: its messages, its range on the grid, and the share of rows without a value."""
    n_channel, n_rows = len(machine.channels), sum(gridded.lengths)
    low, high, n_known = np.full(n_channel, np.inf), np.full(n_channel, -np.inf), np.zeros(n_channel)
    for begin in range(0, n_rows if n_channel else 0, SECTION_ROWS):
        x = channel_values(gridded, begin, min(begin + SECTION_ROWS, n_rows), n_channel).T
        is_known = np.isfinite(x)
        low, high = widened(low, high, x, is_known)
        n_known += is_known.sum(axis=1)
    figures: Figures = {}
    for number, name in enumerate(machine.channel_names):
        found = raw.channels.get(name)
        figures |= {
            f"x_{name}/n": 0 if found is None else len(found.time_ns),
            f"x_{name}/min": float(low[number]),
            f"x_{name}/max": float(high[number]),
            f"x_{name}/share_unknown": float(1.0 - n_known[number] / n_rows),
        }
    return figures


def sampling(intervals_ns: Column, maximum_gap_s: float) -> Figures:
    """Measure the intervals between the samples of a stream in order of time, a column of shape (n,), int64."""
    if not len(intervals_ns):
        return {"rate_hz": None, "interval_s": None, "jitter_s": None, "longest_gap_s": None, "n_gaps": 0}
    low, median, high = quantiles(
        lambda: (part / NANOSECONDS for (part,) in sections((intervals_ns,))), [0.16, 0.5, 0.84]
    )
    gap_ns = maximum_gap_s * NANOSECONDS
    return {
        "rate_hz": 1.0 / median if median > 0 else None,
        "interval_s": median,
        # Half the distance of the 16th and 84th percentile: a standard deviation that is robust to gaps.
        "jitter_s": (high - low) / 2,
        "longest_gap_s": extent(intervals_ns)[1] / NANOSECONDS,
        "n_gaps": sum(int((part > gap_ns).sum()) for (part,) in sections((intervals_ns,))),
    }


def _rounded(value: float | int | None) -> float | int | None:
    if isinstance(value, float):
        return float(f"{value:.{SIGNIFICANT_DIGITS}g}") if np.isfinite(value) else None
    return value
