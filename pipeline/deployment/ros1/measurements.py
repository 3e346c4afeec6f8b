"""What the nodes measured of the real graph, as delay distributions and as a table of their real-time budget."""

import json
from pathlib import Path

import numpy as np

from pipeline.deployment.simulated_time.delays import Distribution
from pipeline.errors import InputError

WARM_UP = 40  # samples of each kind that are left out: connections, first calls
LINKS = {  # link of the simulated graph -> (node, what it measured) whose samples it is drawn from
    "observation": [("autonomous_server", "age joint_states")],
    "command": [("control_interface", "age requested_commands")],
    "inference": [("autonomous_server", "computation DecisionRequest")],
    "timer": [("autonomous_server", "timer"), ("bobcat_e10_sim_driver", "timer")],
}
BUDGET = {  # rows of the real-time table
    "messages: joint state, driver to server": ("autonomous_server", "age joint_states"),
    "server's tick: buffers, conditions, sending": ("autonomous_server", "tick"),
    "inference, from request to command": ("autonomous_server", "computation DecisionRequest"),
    "messages: command, server to interface": ("control_interface", "age requested_commands"),
    "driver's tick: model, sending": ("bobcat_e10_sim_driver", "tick"),
    "server's lateness in waking": ("autonomous_server", "timer"),
    "driver's lateness in waking": ("bobcat_e10_sim_driver", "timer"),
}
Measured = dict[str, dict[str, list[float]]]


def load_measured(folder: Path) -> Measured:
    """What each node wrote: name of the node, name of the quantity, seconds.

    Raises:
        InputError: a node wrote nothing.
    """
    nodes = {node for sources in LINKS.values() for node, _ in sources}
    try:
        return {node: json.loads((folder / f"{node}.json").read_text()) for node in sorted(nodes)}
    except FileNotFoundError as error:
        raise InputError(f"{error.filename}: no such file; the node ended early, see its log") from None


def samples(measured: Measured, node: str, quantity: str) -> np.ndarray:
    """Samples after the warm-up, s.

    Raises:
        InputError: there are none.
    """
    values = np.array(measured[node].get(quantity, [])[WARM_UP:], float)
    if not values.size:
        raise InputError(f"{node} measured `{quantity}` no more than {WARM_UP} times; run for longer")
    return np.maximum(values, 0.0)


def distributions(measured: Measured) -> dict[str, Distribution]:
    """Delays of the simulated graph's links. TCP loses nothing; a full queue would, which holds seconds."""
    return {
        link: Distribution.of(np.concatenate([samples(measured, *source) for source in sources]))
        for link, sources in LINKS.items()
    }


def real_time_table(measured: Measured) -> str:
    """Markdown: median and 99.9th percentile per tick, ms, and the deadlines that were missed."""
    lines = ["| per tick | median, ms | 99.9 %, ms | n |", "|---|---|---|---|"]
    for name, source in BUDGET.items():
        values = samples(measured, *source)
        median, rare = 1e3 * np.quantile(values, [0.5, 0.999])
        lines.append(f"| {name} | {median:.2f} | {rare:.2f} | {len(values)} |")
    for node in ("autonomous_server", "bobcat_e10_sim_driver"):
        missed, ticks = len(measured[node].get("missed", [])), len(measured[node]["tick"])
        lines.append(f"| missed ticks of {node} | {missed} of {missed + ticks} | | |")
    return "\n".join(lines) + "\n"
