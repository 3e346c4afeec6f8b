"""The nodes' measurements of the real graph, as delay distributions and as a real-time table."""

import json
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pipeline.deployment.transports.simulated_time.delays import (
    PLANNING,
    Distribution,
    PlannerEffort,
    save_delays,
)
from pipeline.errors import InputError
from pipeline.files.atomic import write_whole

WARM_UP = 40  # dropped first samples of each kind: connections, first calls
DECISIONS = ("autonomous_server", "computation DecisionRequest")
LINKS: dict[str, list[tuple[str, str]]] = {  # link of the simulated graph -> (node, quantity) of its samples
    "observation": [("autonomous_server", "age joint_states")],
    "command": [("control_interface", "age requested_commands")],
    "inference": [DECISIONS],
    "timer": [("autonomous_server", "timer"), ("bobcat_e10_sim_driver", "timer")],
}
BUDGET = {  # rows of the real-time table
    "messages: joint state, driver to server": ("autonomous_server", "age joint_states"),
    "server's tick: buffers, conditions, sending": ("autonomous_server", "tick"),
    "inference, from request to command": DECISIONS,
    "messages: command, server to interface": ("control_interface", "age requested_commands"),
    "driver's tick: model, sending": ("bobcat_e10_sim_driver", "tick"),
    "server's lateness in waking": ("autonomous_server", "timer"),
    "driver's lateness in waking": ("bobcat_e10_sim_driver", "timer"),
}
Measured = dict[str, dict[str, list[float]]]


def load_measured(folder: Path) -> Measured:
    """Measurements by node and quantity, s.

    Raises:
        InputError: a node's file is missing.
    """
    nodes = {node for sources in LINKS.values() for node, _ in sources}
    try:
        return {node: json.loads((folder / f"{node}.json").read_text()) for node in sorted(nodes)}
    except FileNotFoundError as error:
        raise InputError(f"{error.filename}: no such file; the node ended early, see its log") from None


def samples(measured: Measured, node: str, quantity: str) -> np.ndarray:
    """Samples after the warm-up, s.

    Raises:
        InputError: too few samples were measured.
    """
    values = np.array(measured[node].get(quantity, [])[WARM_UP:], float)
    if not values.size:
        raise InputError(f"{node} measured `{quantity}` no more than {WARM_UP} times; run for longer")
    return np.maximum(values, 0.0)


def distributions(policy: Measured, planner: Measured | None = None) -> dict[str, Distribution]:
    """Delays of the simulated graph's links. TCP does not lose messages, and queues hold seconds of them.

    Args:
        policy: measurements of a run with a learned policy, for all links.
        planner: measurements of a run with a planner, if any, for its decision times.
    """
    links = {
        link: Distribution.of(np.concatenate([samples(policy, *source) for source in sources]))
        for link, sources in LINKS.items()
    }
    if planner is not None:
        links[PLANNING] = Distribution.of(samples(planner, *DECISIONS))
    return links


def real_time_table(runs: Mapping[str, Measured], decision_s: float) -> str:
    """Markdown: median and 99.9th percentile per tick, ms, and the missed deadlines.

    Args:
        runs: measurements by the controller's name.
        decision_s: period of decisions, s, which is their deadline.
    """
    names = "".join(f" {name}: median, ms | 99.9 %, ms | n |" for name in runs)
    lines = [f"| per tick |{names}", "|---|" + "---|---|---|" * len(runs)]
    for row, source in BUDGET.items():
        cells = ""
        for measured in runs.values():
            values = samples(measured, *source)
            median, rare = 1e3 * np.quantile(values, [0.5, 0.999])
            cells += f" {median:.2f} | {rare:.2f} | {len(values)} |"
        lines.append(f"| {row} |{cells}")
    for node in ("autonomous_server", "bobcat_e10_sim_driver"):
        counts = [(len(m[node].get("missed", [])), len(m[node]["tick"])) for m in runs.values()]
        cells = "".join(f" {missed} of {missed + ticks} | | |" for missed, ticks in counts)
        lines.append(f"| missed ticks of {node} |{cells}")
    cells = ""
    for measured in runs.values():
        decisions = samples(measured, *DECISIONS)
        cells += f" {int((decisions > decision_s).sum())} of {len(decisions)} | | |"
    lines.append(f"| decisions later than the next one is due ({1e3 * decision_s:g} ms) |{cells}")
    return "\n".join(lines) + "\n"


def write_measurements(
    delays: Path,
    output: Path,
    runs: Mapping[str, Measured],
    targets: int,
    planner: PlannerEffort | None,
    decision_s: float,
    load_before: float,
) -> str:
    """Write the file of delays, and the real-time table into the folder `output`; the table.

    Args:
        output: A folder.
        runs: What was measured with "PPO" and, if there was a planner, with "iCEM".
        targets: How many were pursued in each.
        planner: What a decision of the planner costs.
        decision_s: Time from one decision to the next.
        load_before: Average load of this computer before the runs.
    """
    how = {
        "command": "measure_delays",
        "targets": targets,
        "controllers": list(runs),
        "cores": len(os.sched_getaffinity(0)),
        "load_average_before": round(load_before, 2),
        "load_average_after": round(os.getloadavg()[0], 2),
    }
    if planner is not None:
        how["planner"] = planner._asdict()
    save_delays(delays, distributions(runs["PPO"], runs.get("iCEM")), how)
    table = real_time_table(runs, decision_s)
    write_whole(output / "real_time.md", table.encode())
    return table
