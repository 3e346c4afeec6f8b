"""The quality report of a folder of logs, as a page."""

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path

from pipeline.errors import counted
from pipeline.files.atomic import write_whole
from pipeline.logs.ingest import IngestSummary
from pipeline.logs.quality import QualityReport
from pipeline.logs.tuples import SUFFIX, thinned_positions
from pipeline.machine.kinematics import Arm, load_arm
from pipeline.machine.log_sources import ClockChoice
from pipeline.machine.specification import MachineSpecification
from pipeline.reporting.figures.clouds import MAXIMUM_POINTS, cloud_of
from pipeline.reporting.figures.workspace import cloud_figure
from pipeline.reporting.page import Figure, KeyFigure, Section, render_page
from pipeline.reporting.table import Table

# Column heading, key behind the joint's name, format, factor
JOINT_COLUMNS = (
    ("from", "position_min", "{:.3f}", 1.0),
    ("to", "position_max", "{:.3f}", 1.0),
    ("fastest [/s]", "speed_max", "{:.3f}", 1.0),
    ("negative [%]", "share_negative", "{:.0f}", 100.0),
    ("zero [%]", "share_zero", "{:.0f}", 100.0),
    ("positive [%]", "share_positive", "{:.0f}", 100.0),
    ("starts", "n_starts", "{:.0f}", 1.0),
    ("moved alone [s]", "alone_s", "{:.0f}", 1.0),
    ("command to motion [s]", "apparent_delay_s", "{:.2f}", 1.0),
    ("encoder frozen", "frozen", "{:.0f}", 1.0),
)
STREAM_COLUMNS = (
    ("messages", "n", "{:.0f}", 1.0),
    ("rate [Hz]", "rate_hz", "{:.2f}", 1.0),
    ("jitter [ms]", "jitter_s", "{:.2f}", 1000.0),
    ("longest gap [ms]", "longest_gap_s", "{:.0f}", 1000.0),
    ("gaps that split", "n_gaps", "{:.0f}", 1.0),
)
CLOCK_COLUMNS = (
    ("log time after stamp [ms]", "offset_s", "{:.2f}", 1000.0),
    ("1 % below [ms]", "offset_p01_s", "{:.2f}", 1000.0),
    ("1 % above [ms]", "offset_p99_s", "{:.2f}", 1000.0),
    ("drift [ppm]", "drift_ppm", "{:z.1f}", 1.0),
)
STREAMS = ("joint_states", "commands")


NAME = "quality.html"


def write(
    machine: MachineSpecification, machine_directory: Path, summary: IngestSummary, tuples: Path, folder: Path
) -> None:
    """Write the page into `folder`.

    Args:
        machine_directory: Folder `conf/machine`.
        summary: Outcome of the ingestion.
        tuples: Folder of the tuples.
    """
    arm = load_arm(machine, machine_directory) if machine.arm is not None else None
    write_whole(folder / NAME, quality_page(machine, arm, summary, tuples).encode())


def quality_page(
    machine: MachineSpecification, arm: Arm | None, summary: IngestSummary, tuples_directory: Path
) -> str:
    """Lay out the quality report.

    Args:
        arm: Its kinematics, for pictures of the workspace; None without a description.
        summary: Outcome of the ingestion.
        tuples_directory: Folder of the tuples.
    """
    sections = [_log_section(machine, arm, report, tuples_directory) for report in summary.reports]
    if summary.failures:
        failed = Table("Logs that failed", ["Log", "Why"], [[f.name, f.reason] for f in summary.failures])
        sections.insert(
            0,
            Section(
                "What failed", f"{counted(len(summary.failures), 'log')} could not be used.", (), [failed]
            ),
        )
    totals = summary.metrics()
    minutes = (totals["duration_s"] or 0) / 60
    n_failed = totals["n_failed"]
    verdict = (
        f"{counted(int(totals['n_logs'] or 0), 'log')}, {minutes:.0f} minutes, {totals['n_rows']} rows of tuples; "
        + ("all could be used." if n_failed == 0 else f"{n_failed} failed.")
    )
    verdict += "".join(
        f" Warning: {report.name}: {text}." for report in summary.reports for text in report.warnings
    )
    notes = sum(note.count for report in summary.reports for note in report.notes)
    return render_page(
        f"Quality of the logs of {machine.name}",
        verdict,
        [
            KeyFigure(f"{minutes:.0f} min", "recorded"),
            KeyFigure(str(totals["n_rows"]), "rows of tuples"),
            KeyFigure(str(n_failed), "logs failed"),
            KeyFigure(str(notes), "samples or messages with a note"),
        ],
        sections,
        [("machine", machine.name), ("rate", f"{machine.rate_hz:g} Hz")],
    )


def _log_section(
    machine: MachineSpecification, arm: Arm | None, report: QualityReport, tuples_directory: Path
) -> Section:
    metrics = report.metrics
    tables = [
        _table("Messages", STREAM_COLUMNS, metrics, STREAMS),
        _table("Header stamps and log time of joint samples", CLOCK_COLUMNS, metrics, ("clock",)),
        _table("Joints and their commands", JOINT_COLUMNS, metrics, machine.joint_names, machine.units),
    ]
    if machine.channels:
        tables.append(_channel_table(machine, metrics))
    if report.notes:
        rows = [[note.kind.replace("_", " "), str(note.count), note.text] for note in report.notes]
        tables.append(Table("What was lost, left out or changed", ["Kind", "How often", "What"], rows))
    figures = []
    if arm is not None and machine.workspace is not None:
        q = thinned_positions(tuples_directory / f"{report.name}{SUFFIX}", machine, MAXIMUM_POINTS)
        figures.append(
            Figure(
                f"Workspace covered in {report.name}",
                "End-effector positions from above and from the side, coloured by pitch; outlined is W+.",
                cloud_figure({report.name: cloud_of(arm, q)}, machine.workspace),
                "image/png",
            )
        )
    clock = "log time" if metrics["clock/uses_log_time"] else "header stamps"
    commands_clock = ClockChoice(machine.commands.clock).replace("_", " ")
    n_trajectories = metrics["n_trajectories"]
    return Section(
        report.name,
        f"{metrics['duration_s']:.0f} s, {metrics['n_rows']} rows in "
        f"{n_trajectories} {'trajectory' if n_trajectories == 1 else 'trajectories'}; "
        f"joint samples are timed by {clock}, commands by {commands_clock}.",
        figures,
        tables,
        [f"Too little for later stages: {finding}" for finding in report.findings],
    )


def _channel_table(machine: MachineSpecification, metrics: Mapping[str, float | int | None]) -> Table:
    rows = []
    for channel in machine.channels:
        n, *values = (metrics[f"x_{channel.name}/{key}"] for key in ("n", "min", "max", "share_unknown"))
        low, high = ("–" if value is None else f"{value:.4g} {channel.unit}" for value in values[:2])
        rows.append(
            [channel.name, str(n) if n else "not in this log", low, high, f"{100 * (values[2] or 0):.0f}"]
        )
    return Table("Channels", ["", "messages", "from", "to", "rows without a value [%]"], rows)


def _table(
    title: str,
    columns: Sequence[tuple[str, str, str, float]],
    metrics: Mapping[str, float | int | None],
    names: Sequence[str],
    units: Sequence[str] = (),
) -> Table:
    rows = []
    for name, unit in zip_longest(names, units):
        values = [(metrics[f"{name}/{key}"], template, factor) for _, key, template, factor in columns]
        cells = ["–" if value is None else form.format(value * factor) for value, form, factor in values]
        rows.append([f"{name} [{unit}]" if unit else name, *cells])
    return Table(title, ["", *(heading for heading, *_ in columns)], rows)
