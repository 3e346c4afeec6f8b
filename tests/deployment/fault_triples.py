"""Faults in sampled triples, each at a sampled phase: what stops the machine too late, or lets it move again.

    python -m tests.deployment.fault_triples --ledger FILE [--minutes 15]

The ledger has a line per run, so that a further call goes on. Each finding is printed.
"""

import argparse
import json
import time
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.deployment.component import NANOSECONDS
from tests.deployment.fault_cases import CUTS, FAULTS, FaultRun, run_faults
from tests.deployment.machines import bobcat, supervised

CONTROL_PERIOD_S = bobcat().dt_s
# when the PLC stops by itself: its time-out, begun with a command of up to a period before, seen in its next cycle
PLC_STOPS_S = supervised().driver.command_timeout_s + CONTROL_PERIOD_S + supervised().driver.can_period_s
# of the server's commands: its last one, zero, is not heard in time either
DISTURBED = ("a command lost", "all commands lost", "commands late by 0.1 s", "commands reordered")
COMMAND_GAP_S = supervised().supervisor.maximum_command_gap_s
LATEST_S = 0.2  # one decision; the first fault sets in at a phase of it, too


def sampled(number: int) -> tuple[list[str], list[int], int]:
    """Names, times after the common onset, ns, and the graph's seed of a run."""
    random = np.random.default_rng(number)
    while True:
        names = random.choice(list(FAULTS), 3, replace=False).tolist()
        if not any(are_of_one_clock(*pair) for pair in combinations(names, 2)):
            return (
                names,
                random.integers(round(LATEST_S * NANOSECONDS), size=3).tolist(),
                int(random.integers(1000)),
            )


def are_of_one_clock(first: str, second: str) -> bool:
    """Whether both step the same clock: one does not step on and back at once."""
    return first.startswith("clock") and first.rsplit(" ", 3)[0] == second.rsplit(" ", 3)[0]


def findings(names: Sequence[str], later_ns: Sequence[int], run: FaultRun) -> list[str]:
    """What went wrong in a run, in words."""
    cut_s = [ns / NANOSECONDS for name, ns in zip(names, later_ns, strict=True) if name in CUTS]
    # what cuts the way to the valves cuts the supervisor's order too: the PLC then stops by itself
    latest_s = max([run.known_s + CONTROL_PERIOD_S, *(s + PLC_STOPS_S for s in cut_s)])
    if run.reaction.startswith("autonomous_server") and set(names) & set(DISTURBED):
        latest_s = max(latest_s, run.known_s + COMMAND_GAP_S + CONTROL_PERIOD_S)
    found = []
    if run.reaction == "none":
        found.append("nobody reacted")
    elif run.known_s + run.stopped_s > latest_s:
        found.append(
            f"valves at zero {run.known_s + run.stopped_s:.3f} s after the onset, not {latest_s:.3f} s"
        )
    if run.commands_after:
        found.append(f"{run.commands_after} commands after the stop")
    if run.moves_after:
        found.append(f"valves open {run.moves_after} cycles after the stop")
    return found


def main() -> None:
    """Go on with the ledger until the processor time is over."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--ledger", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=15.0, help="of processor time")
    options = parser.parse_args()
    number = len(options.ledger.read_text().splitlines()) if options.ledger.exists() else 0
    with options.ledger.open("a") as ledger:
        while time.process_time() < 60.0 * options.minutes:
            names, later_ns, seed = sampled(number)
            found = findings(names, later_ns, run_faults(*names, seed=seed, later_ns=later_ns))
            entry: dict[str, Any] = {
                "number": number,
                "faults": names,
                "later_ns": later_ns,
                "findings": found,
            }
            ledger.write(json.dumps(entry) + "\n")
            ledger.flush()
            if found:
                print(json.dumps(entry), flush=True)
            number += 1
    entries = [json.loads(line) for line in options.ledger.read_text().splitlines()]
    print(f"{len(entries)} runs, {sum(bool(entry['findings']) for entry in entries)} with findings")


if __name__ == "__main__":
    main()
