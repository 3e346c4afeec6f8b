"""Tables of a ledger, and how errors fall with minutes.

Errors of joints are averaged as they are; all joints of a drawn machine turn. Ratios are formed per joint and then
averaged over joints.
"""

import itertools
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

from benchmarks.closed_loop.sessions import machine as drawn_machine
from benchmarks.identification.ledger import Row
from benchmarks.identification.measure import COVERED_STEPS
from pipeline.configuration.load import load_machine
from pipeline.files.atomic import write_whole
from pipeline.reporting.figures.style import REGION, SERIES, StyledFigure, series_style, to_png

FLOOR, OF_LOG = "floor", "/"
HORIZON = "80"
NEW, TODAY = "nfir_dqdot", "mlp_dqdot"
CONFIDENCE = 0.95
WANTED_RATIO, WANTED_EXCESS, WANTED_COVERAGE = 0.70, 0.25, (0.85, 0.95)
MILLI = 1e3
INTRODUCTION = """\
Written by `python -m benchmarks.identification score`; its `--help` has the commands that make the ledger.
Errors of open-loop predictions on held-out recordings: mean over joints and seeds, mrad where not said
otherwise. The floor is half the squared difference of the recording and its replays with other noise: the
squared error of the best prediction. Excess is the squared error over it, less one. Figures that miss their
goal are bold."""
WIDTH_IN, HEIGHT_IN = 7.5, 4.0
BAND_OPACITY = 0.12


@dataclass(frozen=True)
class Results:
    """All rows of a ledger."""

    rows: Sequence[Row]

    def machines(self) -> list[str]:
        """In the order of the ledger."""
        return list(dict.fromkeys(row.machine for row in self.rows))

    def kinds(self) -> list[str]:
        """In the order of the ledger, without replays."""
        return [kind for kind in dict.fromkeys(row.kind for row in self.rows) if kind != FLOOR]

    def minutes(self) -> list[float]:
        """Ascending."""
        return sorted({row.minutes for row in self.rows if row.kind != FLOOR})

    def of(self, machine: str, kind: str, minutes: float | None = None) -> list[Row]:
        """All seeds; minutes do not matter if None."""
        return [
            row
            for row in self.rows
            if (row.machine, row.kind) == (machine, kind) and minutes in (None, row.minutes)
        ]

    def error(
        self, machine: str, kind: str, minutes: float | None = None, horizon: str = HORIZON
    ) -> np.ndarray | None:
        """Root mean square over seeds, (n_joint,); None without a row."""
        found = [row.errors[horizon] for row in self.of(machine, kind, minutes) if horizon in row.errors]
        return np.sqrt(np.mean(np.square(found), axis=0)) if found else None

    def ratio(self, machine: str, one: str, other: str, minutes: float, of_minutes: float) -> float | None:
        """Error of one kind over another's, mean over joints."""
        above, below = self.error(machine, one, minutes), self.error(machine, other, of_minutes)
        return None if above is None or below is None else float(np.mean(above / below))


def interval(ratios: Collection[float]) -> tuple[float, float, float]:
    """Mean ratio over machines with its interval, from logarithms and Student's t; infinite for one machine."""
    logs = np.log(list(ratios))
    if len(logs) < 2:
        return float(np.exp(logs.mean())), 0.0, float("inf")
    half = stats.t.ppf(0.5 + 0.5 * CONFIDENCE, len(logs) - 1) * logs.std(ddof=1) / np.sqrt(len(logs))
    low, mean, high = np.exp(logs.mean() + half * np.array([-1.0, 0.0, 1.0])).tolist()
    return mean, low, high


def error_table(results: Results, minutes: float) -> str:
    """Per machine the error of 80 steps, mean over joints and seeds with the standard deviation over seeds."""
    machines = [
        m
        for m in results.machines()
        if any(row.minutes == minutes for row in results.rows if row.machine == m)
    ]
    head = ["model", *(f"{m}, 80 steps" for m in machines), "1 step", "1000 steps", "training, s"]
    lines = [_floor_line(results, machines, len(head))]
    for kind in results.kinds():
        rows = [row for machine in machines for row in results.of(machine, kind, minutes)]
        if rows:
            lines.append(
                [
                    kind,
                    *(_mean_and_spread(results.of(machine, kind, minutes)) for machine in machines),
                    *(_over_machines(results, machines, kind, minutes, horizon) for horizon in ("1", "1000")),
                    f"{np.mean([row.training_s for row in rows]):.0f}",
                ]
            )
    return _markdown(head, [line for line in lines if line])


def goal_table(results: Results, minutes: float = 24.0) -> str:
    """The goals of the new kind, machine by machine."""
    head = [
        "machine",
        "over MLP Δq̇, ≤ 0.70",
        "excess variance over floor, ≤ 25 %",
        "excess with half the minutes",
        "half the minutes over MLP Δq̇, ≤ 1",
    ]
    lines = []
    for machine in results.machines():
        ratio = results.ratio(machine, NEW, TODAY, minutes, minutes)
        if ratio is None:
            continue
        half = results.ratio(machine, NEW, TODAY, 0.5 * minutes, minutes)
        lines.append(
            [
                machine,
                _judged(f"{ratio:.2f}", ratio <= WANTED_RATIO),
                _excess(results, machine, minutes),
                _excess(results, machine, 0.5 * minutes),
                "" if half is None else _judged(f"{half:.2f}", half <= 1.0),
            ]
        )
    return _markdown(head, lines)


def coverage_table(results: Results, minutes: float = 24.0) -> str:
    """Share of held-out positions in the new kind's 90 % band and its mean width, by joint; mean over seeds."""
    joints = drawn_machine().joint_names
    head = ["machine", "time ahead", *(f"{joint}: covered, 85 to 95 %; width, mrad" for joint in joints)]
    lines = []
    for machine, (step, time) in itertools.product(results.machines(), COVERED_STEPS.items()):
        known = [row.coverage[str(step)] for row in results.of(machine, NEW, minutes) if row.coverage]
        if known:
            covered, width = (np.mean([one[name] for one in known], axis=0) for name in ("covered", "width"))
            is_good = (covered >= WANTED_COVERAGE[0]) & (covered <= WANTED_COVERAGE[1])
            cells = [
                f"{_judged(f'{share:.0%}', good)}; {MILLI * wide:.0f}"
                for share, wide, good in zip(covered, width, is_good, strict=True)
            ]
            lines.append([machine, time, *cells])
    return _markdown(head, lines)


def reference_table(results: Results, minutes: float = 24.0) -> str:
    """The new kind's error over that of each other kind, with the interval of the mean over machines."""
    lines = []
    for kind in results.kinds():
        of_machines = {m: results.ratio(m, NEW, kind, minutes, minutes) for m in results.machines()}
        ratios = [ratio for ratio in of_machines.values() if ratio is not None]
        if kind != NEW and ratios:
            mean, low, high = interval(ratios)
            bounds = f"{low:.2f} to {high:.2f}" if len(ratios) > 1 else ""
            lines.append([kind, f"{mean:.2f}", bounds, f"{len(ratios)}"])
    return _markdown([f"{NEW} over", "mean ratio", "95 % interval", "machines"], lines)


def held_out_table(results: Results, name: str) -> str:
    """Each log of a folder held out in turn: by joint the error of 80 steps, and of 1 step, mean over logs.

    Only over logs on which all kinds were measured.
    """
    machine = load_machine(name)
    shared = [m for m in results.machines() if all(results.of(m, kind) for kind in results.kinds())]
    if not shared:
        return "No log has a row of every kind."
    head = [f"{joint}, m{unit}" for joint, unit in zip(machine.joint_names, machine.units, strict=True)]
    head = ["model", *head, "logs", "training, s"]
    lines = []
    for kind in results.kinds():
        rows = [row for machine in shared for row in results.of(machine, kind)]
        by_horizon = [
            MILLI * np.mean([row.errors[horizon] for row in rows], axis=0) for horizon in (HORIZON, "1")
        ]
        cells = [f"{after:.2f} ({next_one:.3f})" for after, next_one in zip(*by_horizon, strict=True)]
        lines.append([kind, *cells, f"{len(rows)}", f"{np.mean([row.training_s for row in rows]):.0f}"])
    return _markdown(head, lines)


def error_over_minutes(results: Results) -> bytes:
    """One line per model, geometric mean over machines of the error over the floor; a band from least to largest."""
    machines = [m for m in results.machines() if results.error(m, FLOOR) is not None]
    with StyledFigure(WIDTH_IN, HEIGHT_IN) as figure:
        axes = figure.subplots()
        kinds = sorted(
            results.kinds(), key=lambda kind: -len({row.minutes for row in results.rows if row.kind == kind})
        )
        for number, kind in enumerate(kinds[: len(SERIES)]):
            drawn = [
                (minutes, ratios)
                for minutes in results.minutes()
                if (ratios := _over_floor(results, machines, kind, minutes))
            ]
            if not drawn:
                continue
            minutes = [of for of, _ in drawn]
            middle = [float(np.exp(np.mean(np.log(ratios)))) for _, ratios in drawn]
            style = series_style(number)
            axes.plot(minutes, middle, marker="o", markersize=3.0, label=kind, **style)
            least, most = [min(ratios) for _, ratios in drawn], [max(ratios) for _, ratios in drawn]
            if len(drawn) > 1:
                axes.fill_between(
                    minutes, least, most, color=style["color"], alpha=BAND_OPACITY, linewidth=0.0
                )
            else:
                axes.vlines(minutes, least, most, color=style["color"], alpha=3.0 * BAND_OPACITY)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xticks(results.minutes(), [f"{minutes:g}" for minutes in results.minutes()], minor=False)
        axes.minorticks_off()
        ticks = [1.0, 1.5, 2.0, 3.0, 5.0, 10.0]
        axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.axhline(1.0, color=REGION, linewidth=1.0)
        axes.set_xlabel("minutes of logs")
        axes.set_ylabel("4 s error over repeatability floor")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        return to_png(figure)


def write_score(rows: Iterable[Row], markdown: Path | None, plot: Path | None) -> None:
    """Print the tables, and write them and the plot where asked for."""
    known = list(rows)
    results = Results([row for row in known if OF_LOG not in row.machine])
    parts = [INTRODUCTION, goal_table(results), coverage_table(results), reference_table(results)]
    parts += [f"{minutes:g} minutes:\n\n{error_table(results, minutes)}" for minutes in results.minutes()]
    for name in dict.fromkeys(row.machine.partition(OF_LOG)[0] for row in known if OF_LOG in row.machine):
        of_logs = Results([row for row in known if row.machine.startswith(name + OF_LOG)])
        parts.append(f"{name}, 80 steps (1 step):\n\n{held_out_table(of_logs, name)}")
    text = "\n\n".join(parts) + "\n"
    print(text)
    if markdown is not None:
        write_whole(markdown, text.encode())
    if plot is not None:
        write_whole(plot, error_over_minutes(results))


def _over_floor(results: Results, machines: Collection[str], kind: str, minutes: float) -> list[float]:
    """By machine, mean over joints."""
    ratios = [results.ratio(machine, kind, FLOOR, minutes, 0.0) for machine in machines]
    return [ratio for ratio in ratios if ratio is not None]


def _floor_line(results: Results, machines: Sequence[str], n_column: int) -> list[str]:
    floors = [results.error(machine, FLOOR) for machine in machines]
    if not any(floor is not None for floor in floors):
        return []
    line = [
        "floor (replays)",
        *("" if floor is None else f"{MILLI * floor.mean():.1f}" for floor in floors),
        "",
    ]
    line.append(_over_machines(results, machines, FLOOR, 0.0, "1000"))
    return line + [""] * (n_column - len(line))


def _mean_and_spread(rows: Sequence[Row]) -> str:
    means = [MILLI * float(np.mean(row.errors[HORIZON])) for row in rows]
    if not means:
        return ""
    spread = f" ± {np.std(means, ddof=1):.1f}" if len(means) > 1 else ""
    return f"{np.mean(means):.1f}{spread}"


def _over_machines(results: Results, machines: Sequence[str], kind: str, minutes: float, horizon: str) -> str:
    errors = [results.error(machine, kind, minutes, horizon) for machine in machines]
    known = [MILLI * float(error.mean()) for error in errors if error is not None]
    return f"{np.mean(known):.2f}" if known and horizon == "1" else f"{np.mean(known):.0f}" if known else ""


def _excess(results: Results, machine: str, minutes: float) -> str:
    """Of the new kind's squared error over the floor, mean over joints."""
    floor, error = results.error(machine, FLOOR), results.error(machine, NEW, minutes)
    if floor is None or error is None:
        return ""
    excess = float(np.mean((error / floor) ** 2 - 1.0))
    return _judged(f"{excess:.0%}", excess <= WANTED_EXCESS)


def _judged(text: str, is_good: bool) -> str:
    """Figures that miss their goal are bold, as in the page of the blind benchmark."""
    return text if is_good else f"**{text}**"


def _markdown(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)
