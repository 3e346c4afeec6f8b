"""How often the supervisor's rule `model_residual` stops a sound machine, and how soon it stops a faulty one.

    python -m benchmarks.false_stops --model MODEL --floor FLOOR --ledger FILE [--minutes 20]

Sessions of the simulated machine are drawn one after the other until the processor time is over; the ledger has a
line for each, so that a further call goes on. In a session with a fault, one joint turns to a share of its speed.
"""

import argparse
import json
import time
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.configuration.load import load_machine
from pipeline.deployment.components.supervision.free_running_model import FreeRunningModel
from pipeline.deployment.components.supervision.model_floor import (
    BLOCK_STEPS,
    ModelFloor,
    MovingSteps,
    blocks_of,
    evidence,
    read_floor,
)
from pipeline.effects.store import dynamics_fingerprint, load_dynamics
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.effects.effect import scaled
from pipeline.plant.machines.bobcat_e10 import bobcat_e10
from pipeline.plant.machines.characterise import full_speed
from pipeline.plant.machines.variants import draw_variant
from pipeline.plant.parameters import Parameters
from pipeline.plant.recording.operator import draw_style
from pipeline.plant.recording.session import NANOSECONDS, SessionLog, record_session

SOUND_MINUTES, FAULTY_MINUTES, ONSET_S = 15.0, 3.0, 60.0
# Sound: the machine that the model was identified on; others of its build; a cold morning, a hot afternoon.
CONDITIONS = ("as identified", "another machine", "oil 15 K colder", "oil 15 K warmer")
OIL_K = {"oil 15 K colder": -15.0, "oil 15 K warmer": 15.0}
SPEEDS = (0.5, 0.0)
BISECTIONS = 12


def sessions() -> Iterator[dict[str, Any]]:
    """What is driven, without end: of five sessions four are sound."""
    number = 0
    while True:
        for condition in CONDITIONS:
            yield {"number": number, "condition": condition, "minutes": SOUND_MINUTES}
            number += 1
        of_joint = number // len(CONDITIONS)
        fault = {"joint": of_joint % 4, "speed": SPEEDS[of_joint // 4 % len(SPEEDS)]}
        for _ in range(3):
            yield {"number": number, "condition": CONDITIONS[0], "minutes": FAULTY_MINUTES, **fault}
            number += 1


@cache
def with_speed(joint: int, share: float) -> Parameters:
    """The machine with both metering edges of a joint's spool narrowed, to a share of its full speed."""
    nominal = bobcat_e10()

    def narrowed(area: float) -> Parameters:
        spool = nominal.spool
        inlet, outlet = (
            scaled(of, (joint, [0, 1]), area) for of in (spool.inlet_area_m2, spool.outlet_area_m2)
        )
        return nominal.change("spool", inlet_area_m2=inlet, outlet_area_m2=outlet)

    low, high = 1e-3, 1.0
    if share == 0.0:
        return narrowed(low)
    for _ in range(BISECTIONS):
        area = 0.5 * (low + high)
        speed = np.mean(
            [full_speed(narrowed(area), joint, d) / full_speed(nominal, joint, d) for d in (-1, 1)]
        )
        low, high = (area, high) if speed < share else (low, area)
    return narrowed(high)


def drive(machine: MachineSpecification, session: dict[str, Any]) -> SessionLog:
    """The session's recording."""
    parameters, seed = bobcat_e10(), 10_000 + session["number"]
    if session["condition"] == "another machine":
        parameters = draw_variant(parameters, seed)
    start_C = parameters.oil.start_C + OIL_K.get(session["condition"], 0.0)
    parameters = parameters.change("oil", start_C=start_C)
    changes = [(ONSET_S, with_speed(session["joint"], session["speed"]))] if "joint" in session else []
    return record_session(machine, parameters, draw_style(seed), session["minutes"], seed, 0, changes)


def rows(machine: MachineSpecification, log: SessionLog) -> tuple[np.ndarray, np.ndarray]:
    """Positions and commands in force on the machine's grid, (T, n_joint) each."""
    stamps, commands = log.joint_state_header_stamp_ns, log.command_log_time_ns
    grid = np.arange(max(stamps[0], commands[0]), stamps[-1], round(machine.dt_s * NANOSECONDS))
    q = np.stack([np.interp(grid, stamps, position) for position in log.positions.T], axis=1)
    return q, log.commands[np.searchsorted(commands, grid, side="right") - 1].astype(float)


def judged(
    machine: MachineSpecification, follower: FreeRunningModel, floor: ModelFloor, session: dict[str, Any]
) -> dict[str, Any]:
    """The session with each joint's highest evidence, as a share of its limit, and the first alarm of each."""
    q, a = rows(machine, drive(machine, session))
    expected, measured = follower.displacements(q, a), np.diff(q, axis=0)
    counts = MovingSteps(follower.specification).count(q[:-1], expected, measured)
    counts[: follower.settling_steps] = False
    highest, alarms = [], []
    for joint, name in enumerate(machine.joint_names):
        at = np.flatnonzero(counts[:, joint])
        blocks = blocks_of(expected[at, joint], measured[at, joint])
        reached = evidence(floor.log_e_value(joint, *blocks)) / floor.limit[joint]
        highest.append(round(float(max(reached, default=0.0)), 3))
        raised = np.flatnonzero(reached >= 1.0)
        if len(raised):
            row = at[BLOCK_STEPS * (raised[0] + 1) - 1] + 1
            moving = counts[round(ONSET_S / machine.dt_s) : row, joint].sum()
            alarms.append({"joint": name, "t": row * machine.dt_s, "moving_s": moving * machine.dt_s})
    return {**session, "highest": highest, "alarms": alarms}


def main() -> None:
    """Go on with the ledger, and print what it holds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--model", type=Path, required=True)
    parser.add_argument("--floor", type=Path, required=True)
    parser.add_argument("--ledger", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=20.0, help="of processor time")
    options = parser.parse_args()
    machine = load_machine("bobcat_e10")
    follower = FreeRunningModel(*load_dynamics(options.model, machine), machine)
    floor = read_floor(options.floor, dynamics_fingerprint(options.model))
    n_done = len(options.ledger.read_text().splitlines()) if options.ledger.exists() else 0
    with options.ledger.open("a") as ledger:
        for session in sessions():
            if session["number"] < n_done:
                continue
            if time.process_time() > 60.0 * options.minutes:
                break
            ledger.write(json.dumps(judged(machine, follower, floor, session)) + "\n")
            ledger.flush()
    print(summary([json.loads(line) for line in options.ledger.read_text().splitlines()]))


def summary(ledger: list[dict[str, Any]]) -> str:
    """Tables: sound sessions by condition, faults by joint and speed."""
    lines = ["| condition | hours | false stops | highest evidence per limit |", "|---|---|---|---|"]
    sound = [entry for entry in ledger if "joint" not in entry]
    for condition in CONDITIONS:
        of = [entry for entry in sound if entry["condition"] == condition]
        stops = sum(bool(entry["alarms"]) for entry in of)
        highest = max((max(entry["highest"]) for entry in of), default=0.0)
        lines.append(f"| {condition} | {sum(e['minutes'] for e in of) / 60:.2f} | {stops} | {highest:.2f} |")
    lines += ["", "| joint | speed | sessions | stopped | s of motion until then: median, most |"]
    lines += ["|---|---|---|---|---|"]
    faulty = [entry for entry in ledger if "joint" in entry]
    for (joint, speed), n in sorted(Counter((e["joint"], e["speed"]) for e in faulty).items()):
        moving_s = [
            alarm["moving_s"]
            for e in faulty
            if (e["joint"], e["speed"]) == (joint, speed)
            for alarm in e["alarms"]
            if alarm["joint"] == load_machine("bobcat_e10").joint_names[joint] and alarm["t"] > ONSET_S
        ]
        times = f"{np.median(moving_s):.2f}, {max(moving_s):.2f}" if moving_s else ""
        lines.append(f"| {joint} | {speed} | {n} | {len(moving_s)} | {times} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
