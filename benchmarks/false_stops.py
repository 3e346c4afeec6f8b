"""How often the supervisor's rules stop a sound machine, and how soon `model_residual` stops a faulty one.

    python -m benchmarks.false_stops --condition workshop --model MODEL --floor FLOOR --ledger FILE [--minutes 20]

Model and floor are those of this condition of the plant. Sessions of it are drawn one after the other until the
processor time is over; the ledger has a line for each, so that a further call goes on. In a session with a fault, one
joint turns to a share of its speed. Commands reach the supervisor with the delays of the ROS graph.
"""

import argparse
import json
import time
from collections import Counter
from collections.abc import Iterator
from functools import cache
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.rule_arrays import Heard, Parts, holds, objections
from pipeline.configuration.load import MACHINE_DIRECTORY, load_machine, load_section
from pipeline.deployment.component import nanoseconds
from pipeline.deployment.components.supervision.free_running_model import FreeRunningModel
from pipeline.deployment.components.supervision.model_floor import ModelFloor, read_floor
from pipeline.deployment.components.supervision.motion_window import MotionSteps, evidence
from pipeline.deployment.components.supervision.supervisor_rules import RuleParts
from pipeline.deployment.settings import DeploymentConfig
from pipeline.deployment.transports.simulated_time.delays import load_delays
from pipeline.effects.store import dynamics_fingerprint, load_dynamics
from pipeline.plant.effects.effect import scaled
from pipeline.plant.machines.bobcat_e10 import bobcat_e10
from pipeline.plant.machines.characterise import full_speed
from pipeline.plant.machines.field import PAUSE_S, draw_shift
from pipeline.plant.machines.simulated import Condition, simulated_machine
from pipeline.plant.parameters import Parameters
from pipeline.plant.recording.operator import draw_style
from pipeline.plant.recording.session import SessionLog, record_session

MACHINE = load_machine("bobcat_e10")
SOUND_MINUTES, FAULTY_MINUTES, ONSET_S = 15.0, 3.0, 60.0
SPEEDS = (0.5, 0.0)
SOUND_PER_FAULT = 8
BISECTIONS = 12
LONGEST_ROWS = round(SOUND_MINUTES * 60.0 / MACHINE.dt_s)


def sessions(number: int) -> Iterator[dict[str, Any]]:
    """What is driven from a session's number on, without end."""
    while True:
        for _ in range(SOUND_PER_FAULT):
            yield {"number": number, "minutes": SOUND_MINUTES}
            number += 1
        at = number // (SOUND_PER_FAULT + 1)
        fault = {"joint": at % MACHINE.n_joint, "speed": SPEEDS[at // MACHINE.n_joint % len(SPEEDS)]}
        yield {"number": number, "minutes": FAULTY_MINUTES, **fault}
        number += 1


@cache
def with_speed(condition: Condition, joint: int, share: float) -> Parameters:
    """The machine with both metering edges of a joint's spool narrowed, to a share of its full speed."""
    nominal = simulated_machine(MACHINE.name, condition)

    def narrowed(of: Parameters, area: float) -> Parameters:
        inlet, outlet = (
            scaled(edge, (joint, [0, 1]), area) for edge in (of.spool.inlet_area_m2, of.spool.outlet_area_m2)
        )
        return of.change("spool", inlet_area_m2=inlet, outlet_area_m2=outlet)

    low, high, workshop = 1e-3, 1.0, bobcat_e10()
    if share == 0.0:
        return narrowed(nominal, low)
    for _ in range(BISECTIONS):
        area = 0.5 * (low + high)
        speed = np.mean(
            [full_speed(narrowed(workshop, area), joint, d) / full_speed(workshop, joint, d) for d in (-1, 1)]
        )
        low, high = (area, high) if speed < share else (low, area)
    return narrowed(nominal, high)


def drive(condition: Condition, session: dict[str, Any]) -> SessionLog:
    """The session's recording."""
    seed, minutes = 10_000 + session["number"], session["minutes"]
    shift = draw_shift(seed, 60.0 * minutes) if condition is Condition.field else None
    changes = []
    if "joint" in session:
        changes = [(ONSET_S, with_speed(condition, session["joint"], session["speed"]))]
    parameters = simulated_machine(MACHINE.name, condition)
    return record_session(MACHINE, parameters, draw_style(seed), minutes, seed, 0, changes, shift=shift)


class Listener:
    """What the supervisor hears of recordings."""

    def __init__(self, config: DeploymentConfig) -> None:
        self._quantiles_s = load_delays(Path(config.delays)).links["command"].quantiles_s

    def pieces(self, log: SessionLog, seed: int) -> Iterator[Heard]:
        """A recording in pieces in which the engine was on: with it the graph is started anew."""
        sent_ns, states_ns = log.command_log_time_ns, log.joint_state_log_time_ns
        uniform = np.random.default_rng(seed).random(len(sent_ns))
        delay_s = np.interp(uniform, np.linspace(0.0, 1.0, len(self._quantiles_s)), self._quantiles_s)
        heard_ns = np.maximum.accumulate(sent_ns + np.round(delay_s * 1e9).astype(np.int64))
        pause_ns = nanoseconds(PAUSE_S[0])
        begins = [*sent_ns[np.diff(sent_ns, prepend=-pause_ns) >= pause_ns] - pause_ns // 2, np.inf]
        for begin, end in pairwise(begins):
            command = (sent_ns >= begin) & (sent_ns < end)
            state = (states_ns >= begin) & (states_ns < end)
            yield Heard(
                log.joint_state_header_stamp_ns[state],
                states_ns[state],
                log.positions[state],
                sent_ns[command],
                heard_ns[command],
                log.commands[command].astype(float),
            )


def rows(heard: Heard) -> tuple[np.ndarray, np.ndarray]:
    """Positions and commands in force on the machine's grid, (T, n_joint) each."""
    grid = np.arange(heard.stamp_ns[0], heard.stamp_ns[-1], nanoseconds(MACHINE.dt_s))
    q = np.stack([np.interp(grid, heard.stamp_ns, position) for position in heard.q.T], axis=1)
    before = np.searchsorted(heard.command_ns, grid, side="right")
    return q, np.concatenate([np.zeros((1, MACHINE.n_joint)), heard.a])[before]


def residual(
    follower: FreeRunningModel, floor: ModelFloor, heard: Heard
) -> tuple[list[float], list[dict[str, Any]]]:
    """Each joint's highest evidence, as a share of its limit, and the first alarm of each."""
    q, a = rows(heard)
    filled = (
        np.pad(q, ((0, LONGEST_ROWS - len(q)), (0, 0)), "edge"),
        np.pad(a, ((0, LONGEST_ROWS - len(a)), (0, 0))),
    )
    expected, measured = follower.displacements(*filled)[: len(q) - 1], np.diff(q, axis=0)
    steps, n = MotionSteps(follower.specification, floor.speed), floor.window_steps
    around = steps.around(expected)
    judged = slice(follower.settling_steps, len(around))
    counts = np.zeros((len(around), MACHINE.n_joint), bool)
    counts[judged] = steps.count(q[judged], around[judged], measured[judged])
    highest, alarms = [], []
    for joint, name in enumerate(MACHINE.joint_names):
        at = np.flatnonzero(counts[:, joint])
        terms = steps.terms(around[at, joint], measured[at, joint])
        sums = np.cumsum(np.pad(terms, ((1, 0), (0, 0), (0, 0))), axis=0)
        reached = evidence(sums[n:] - sums[:-n]) / floor.limit[joint]
        highest.append(round(float(max(reached, default=0.0)), 3))
        raised = at[n - 1 :][reached >= 1.0]
        if len(raised):
            row = raised[0] + 1 + steps.lead
            moving = counts[round(ONSET_S / MACHINE.dt_s) : row, joint].sum()
            alarms.append({"joint": name, "t": row * MACHINE.dt_s, "moving_s": moving * MACHINE.dt_s})
    return highest, alarms


def stops(parts: Parts, heard: Heard, log: SessionLog) -> dict[str, int]:
    """How often each other rule would have stopped the machine, which a reset sets free again.

    Of `envelope` those count as false in which the true tip was inside at both ends of the control period.
    """
    found = {}
    for rule, times_ns in objections(parts, heard).items():
        first = times_ns[np.diff(times_ns, prepend=-np.inf) > nanoseconds(parts.config.neutral_s)]
        if len(first):
            found[rule] = len(first)
        if rule == "envelope" and len(first):
            after = np.searchsorted(log.command_log_time_ns, first)
            around = log.true_positions[np.clip(np.stack([after - 2, after - 1]), 0, None)]
            is_inside = holds(parts.envelope, around.reshape(-1, MACHINE.n_joint)).reshape(2, -1)
            found["envelope, tip inside"] = int(is_inside.all(axis=0).sum())
    return found


def main() -> None:
    """Go on with the ledger, and print what it holds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--condition", type=Condition, required=True)
    parser.add_argument("--model", type=Path, required=True)
    parser.add_argument("--floor", type=Path, required=True)
    parser.add_argument("--ledger", type=Path, required=True)
    parser.add_argument("--first", type=int, default=0, help="number of the ledger's first session")
    parser.add_argument("--minutes", type=float, default=20.0, help="of processor time")
    options = parser.parse_args()
    config = load_section("deployment", DeploymentConfig, "default")
    follower = FreeRunningModel(*load_dynamics(options.model, MACHINE), MACHINE)
    floor = read_floor(options.floor, dynamics_fingerprint(options.model))
    built = RuleParts(MACHINE, config.supervisor, MACHINE_DIRECTORY)
    parts, listener = Parts(MACHINE, config.supervisor, built.shapes, built.envelope), Listener(config)
    n_done = len(options.ledger.read_text().splitlines()) if options.ledger.exists() else 0
    with options.ledger.open("a") as ledger:
        for session in islice(sessions(options.first), n_done, None):
            if time.process_time() > 60.0 * options.minutes:
                break
            log, counted = drive(options.condition, session), Counter[str]()
            judged = []
            for heard in listener.pieces(log, session["number"]):
                judged.append(residual(follower, floor, heard))
                if "joint" not in session:
                    counted.update(stops(parts, heard, log))
            highest = np.max([of for of, _ in judged], axis=0).tolist()
            alarms = [alarm for _, of in judged for alarm in of]
            ledger.write(
                json.dumps({**session, "highest": highest, "alarms": alarms, "stops": counted}) + "\n"
            )
            ledger.flush()
    print(summary([json.loads(line) for line in options.ledger.read_text().splitlines()]))


def summary(ledger: list[dict[str, Any]]) -> str:
    """Tables: stops of sound sessions by rule; faults by joint and speed."""
    sound = [entry for entry in ledger if "joint" not in entry]
    hours = sum(entry["minutes"] for entry in sound) / 60
    counted = Counter({"model_residual": sum(bool(entry["alarms"]) for entry in sound)})
    for entry in sound:
        counted.update(entry["stops"])
    highest = max((max(entry["highest"]) for entry in sound), default=0.0)
    lines = [f"{hours:.2f} hours; highest evidence of `model_residual` per limit {highest:.2f}", ""]
    lines += ["| rule | stops | per hour |", "|---|---|---|"]
    lines += [f"| {rule} | {n} | {n / hours:.3f} |" for rule, n in sorted(counted.items())]
    lines += ["", "| joint | speed | sessions | stopped | s of motion until then: median, most |"]
    lines += ["|---|---|---|---|---|"]
    faulty = [entry for entry in ledger if "joint" in entry]
    for (joint, speed), n in sorted(Counter((e["joint"], e["speed"]) for e in faulty).items()):
        moving_s = [
            alarm["moving_s"]
            for e in faulty
            if (e["joint"], e["speed"]) == (joint, speed)
            for alarm in e["alarms"]
            if alarm["joint"] == MACHINE.joint_names[joint] and alarm["t"] > ONSET_S
        ]
        times = f"{np.median(moving_s):.2f}, {max(moving_s):.2f}" if moving_s else ""
        lines.append(f"| {joint} | {speed} | {n} | {len(moving_s)} | {times} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
