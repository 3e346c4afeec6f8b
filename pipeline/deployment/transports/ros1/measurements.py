"""The nodes' measurements of the real graph, as delay distributions and as a real-time table."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pipeline.deployment.transports.simulated_time.delays import PLANNING, Distribution
from pipeline.errors import InputError

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
