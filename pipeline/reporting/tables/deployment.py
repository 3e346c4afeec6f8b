"""The paper's tables of Sim2Sim and Sim2Real with our results, and measurements from a deployment's bags."""

import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.machine.specification import MachineSpecification
from pipeline.reporting.results.controllers import controller_title, split_name
from pipeline.reporting.results.deployments import Deployment, Drive, Where
from pipeline.reporting.results.paper import (
    ALGORITHM_NAMES,
    DEPLOYMENT_COLUMNS,
    KIND_NAMES,
    PAPER_EPISODES,
    PAPER_TARGETS,
    SIM2REAL,
    SIM2SIM,
    machine_note,
)
from pipeline.reporting.table import Table

PAPER_PLACES = {Where.brax: "Brax", Where.graph: "Gazebo", Where.plant: "Machine"}
IN_WORDS = {
    Where.brax: "in Brax",
    Where.graph: "through the graph with its delays",
    Where.plant: "on the plant",
}
LEGEND = (
    "SR(p, α): share of trials within p m and α rad of the target at one tick at least. OOW, OOZ: share of trials that "
    "left the restricted workspace, or its lower plane, at any tick. ‡ r^ε and r^X set to zero. One seed each."
)
GRAPH = (
    "Graph: our components in simulated time, with delays and jitter as measured on the ROS graph, the learned model "
    "in the machine's place; the paper has ROS and Gazebo there. Trials end by time-out, safety measures are off."
)
PLANT = (
    "Plant: the simulated machine, which the model was learned from logs of; each trial begins where the one before it "
    "ended. Above it the graph, over the same first targets, each from a start of its own."
)
DELAY_NAMES = {
    "joint_state_recording_s": "joint state, from sampling to recording",
    "joint_state_interval_s": "between joint states",
    "command_interval_s": "between commands",
    "state_age_at_command_s": "newest joint state when a command arrives",
    "decision_age_s": "from joint state to the command decided on it",
    "request_to_command_s": "from server to interface",
}


def sim2sim_table(deployments: Sequence[Deployment], origin: str) -> Table:
    """Brax beside the graph, over the same episodes."""
    drives = [drive for deployment in deployments for drive in deployment.sim2sim]
    rows = _rows(drives, (Where.brax, Where.graph), SIM2SIM, PAPER_EPISODES)
    notes = [LEGEND, GRAPH, _missing(deployments), machine_note(origin)]
    return _table("Sim2Sim transfer: the same episodes in Brax and in the graph", "Episodes", rows, notes)


def sim2real_table(deployments: Sequence[Deployment], origin: str) -> Table | None:
    """The graph beside the plant, over the same targets; None without trials on the plant."""
    drives = [drive for deployment in deployments for drive in deployment.sim2real]
    if not drives:
        return None
    rows = _rows(drives, (Where.graph, Where.plant), SIM2REAL, PAPER_TARGETS)
    notes = [LEGEND, GRAPH, PLANT, machine_note(origin)]
    return _table("Sim2Real transfer: successive targets on the plant", "Trials", rows, notes)


def table_in_field(content: Mapping[str, Any]) -> Table:
    """The table of Sim2Real that a run in the field wrote as JSON."""
    rows = [list(row.values()) for row in content["rows"]]
    return _table(f"{content['title']}, in the field", "Trials", rows, content["notes"])


def until_goal_table(machine: MachineSpecification, deployments: Sequence[Deployment]) -> Table | None:
    """Trials that end at the goal: number and duration; None without such trials."""
    rows = []
    for deployment in deployments:
        if deployment.until_goal is None:
            continue
        goals = deployment.until_goal["goals"]
        times_s = [goal["ticks"] * machine.dt_s for goal in goals if goal["outcome"] == "reached"]
        rows.append(
            [
                *_labels(deployment.name),
                str(len(goals)),
                str(len(times_s)),
                f"{statistics.median(times_s):.1f}" if times_s else "–",
                f"{max(times_s):.1f}" if times_s else "–",
            ]
        )
    if not rows:
        return None
    return Table(
        "Successive targets on the plant, each until it is within 0.12 m and 0.08 rad",
        ["Algo.", "Dyn. model", "Trials", "Reached", "Median time [s]", "Longest [s]"],
        rows,
        ["As the paper's last experiment, whose result it shows in pictures. Times are of those reached."],
    )


def delays_table(deployments: Sequence[Deployment]) -> Table | None:
    """Delays in the plant's bags, ms; None without bags."""
    rows = [
        [
            *_labels(deployment.name),
            title,
            *(f"{1e3 * seen[key]:.1f}" for key in ("median", "p99", "maximum")),
            str(seen["n"]),
        ]
        for deployment in deployments
        for name, title in DELAY_NAMES.items()
        if (seen := deployment.delays.get(name)) is not None
    ]
    if not rows:
        return None
    columns = ["Algo.", "Dyn. model", "Delay", "Median [ms]", "99 % [ms]", "Longest [ms]", "Number"]
    notes = ["Read from the bags by evaluate_logs, as from any other recording."]
    return Table("Delays seen on the plant", columns, rows, notes, merged=2)


def success_rate_changes(deployments: Sequence[Deployment]) -> list[str]:
    """A sentence per controller and step of transfer: change of its success rates, and of the paper's."""
    sentences = []
    for deployment in deployments:
        for drives, published in ((deployment.sim2sim, SIM2SIM), (deployment.sim2real, SIM2REAL)):
            if len(drives) == 2:
                sentences.append(_change(drives[0], drives[1], published))
    return sentences


def transfers(deployments: Sequence[Deployment]) -> list[str]:
    """One sentence per controller: its success rates through the graph and on the plant, and the paper's."""
    sentences = []
    for deployment in deployments:
        reached = [(deployment.sim2sim[-1], SIM2SIM)] + [
            (drive, SIM2REAL) for drive in deployment.sim2real[-1:]
        ]
        coarse, fine, papers = (
            [f"{100 * rate:.0f} %" for rate in rates]
            for rates in (
                [drive.metrics["sr_012_008"] for drive, _ in reached],
                [drive.metrics["sr_002_002"] for drive, _ in reached],
                [
                    published[PAPER_PLACES[drive.where]][drive.name]["sr_002_002"]
                    for drive, published in reached
                    if drive.name in published[PAPER_PLACES[drive.where]]
                ],
            )
        )
        places = " and ".join(
            f"{rate} of {drive.n_trials} targets {IN_WORDS[drive.where]}"
            for rate, (drive, _) in zip(coarse, reached, strict=True)
        )
        sentences.append(
            f"{controller_title(deployment.name)} comes within 0.12 m and 0.08 rad of {places}, "
            f"within 0.02 m and 0.02 rad of {' and '.join(fine)}"
            + (f" (the paper's: {' and '.join(papers)})." if papers else ".")
        )
    return sentences


def _change(before: Drive, after: Drive, published: Mapping[str, Mapping[str, Mapping[str, float]]]) -> str:
    ours, papers = [], []
    for metric in ("sr_002_002", "sr_012_008"):
        ours.append(
            f"{DEPLOYMENT_COLUMNS[metric]} from {before.metrics[metric]:.2f} to {after.metrics[metric]:.2f}"
        )
        rows = [published[PAPER_PLACES[drive.where]].get(drive.name) for drive in (before, after)]
        if rows[0] is not None and rows[1] is not None:
            papers.append(f"{rows[0][metric]:.2f} to {rows[1][metric]:.2f}")
    sentence = (
        f"{controller_title(before.name)}, {before.where} to {after.where.lower()} ({after.n_trials} trials): "
        + ", ".join(ours)
    )
    return sentence + (f"; in the paper {', '.join(papers)}." if papers else ".")


def _rows(
    drives: Sequence[Drive],
    places: Sequence[Where],
    published: Mapping[str, Mapping[str, Mapping[str, float]]],
    n_published: int,
) -> list[list[str]]:
    rows = []
    for place in places:
        for drive in drives:
            if drive.where is not place:
                continue
            rows.append([place, *_labels(drive.name), "ours", *_figures(drive.metrics), str(drive.n_trials)])
            row = published[PAPER_PLACES[place]].get(drive.name)
            if row is not None:
                rows.append([place, *_labels(drive.name), "paper", *_figures(row), str(n_published)])
    return rows


def _table(title: str, counted: str, rows: Sequence[Sequence[str]], notes: Sequence[str]) -> Table:
    columns = ["Where", "Algo.", "Dyn. model", "Whose", *DEPLOYMENT_COLUMNS.values(), counted]
    rules = [index for index in range(1, len(rows)) if rows[index][0] != rows[index - 1][0]]
    return Table(title, columns, rows, [note for note in notes if note], 3, rules)


def _missing(deployments: Sequence[Deployment]) -> str:
    names = {deployment.name for deployment in deployments}
    missing = [controller_title(name) for name in SIM2SIM["Brax"] if name not in names]
    return f"Not run: {', '.join(missing)}." if missing else ""


def _labels(name: str) -> list[str]:
    algorithm, kind = split_name(name)
    return [ALGORITHM_NAMES[algorithm], KIND_NAMES[kind]]


def _figures(metrics: Mapping[str, float]) -> list[str]:
    digits = {"oow": 3, "ooz": 3, "min_z_m": 3}
    return [f"{metrics[metric]:.{digits.get(metric, 2)}f}" for metric in DEPLOYMENT_COLUMNS]
