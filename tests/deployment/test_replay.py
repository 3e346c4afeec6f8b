"""Recorded bags through the supervisor: a rule objects where the bag itself shows a reason, and nowhere else."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from pipeline.configuration.load import MACHINE_DIRECTORY, load_machine, load_section
from pipeline.deployment.component import NANOSECONDS, nanoseconds
from pipeline.deployment.components.supervision.supervisor_rules import RULES, RuleParts, build_rules
from pipeline.deployment.components.velocity_estimator import VelocityEstimator
from pipeline.deployment.messages import JointCommand, JointState
from pipeline.deployment.settings import DeploymentConfig, SupervisorConfig
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.formats.discovery.log_entry import LogEntry
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.messages.columns import as_array
from pipeline.machine.kinematics import load_arm
from pipeline.machine.specification import MachineSpecification
from pipeline.machine.workspace import contains
from pipeline.plant.machines.simulated import simulated_machine
from pipeline.plant.recording.operator import draw_style
from pipeline.plant.recording.session import record_session
from pipeline.testbench.recording import write_session

MEASURED = Path(__file__).parents[3] / "shared/measured"  # of rc_excavator, a real machine
BAGS = sorted(path.parent for path in MEASURED.glob("*/*/metadata.yaml"))
SHORT = "manual_mitch_1101_2333"
CONFIG: SupervisorConfig = load_section("deployment", DeploymentConfig, "default").supervisor
TICK_S = CONFIG.period_s
OF_AN_ARM = ("self_collision", "envelope")  # which only a described arm has


def objections(entry: LogEntry, machine: MachineSpecification, names: Sequence[str]) -> dict[str, str]:
    """The first objection of every rule to a bag, whose commands count as requests of one server."""
    raw = read_log(entry, machine)
    config = dataclasses.replace(CONFIG, rules=list(names))
    rules = build_rules(RuleParts(machine, config, MACHINE_DIRECTORY))
    estimator = VelocityEstimator(nanoseconds(machine.dt_s), LoopTrackerConfig(10.0, 60.0))
    stamps, heard, q = map(as_array, (raw.joint_stamp_ns, raw.joint_log_time_ns, raw.q))
    sent, values = as_array(raw.command_log_time_ns), as_array(raw.command)
    ticks = range(int(heard[0]), int(heard[-1]), nanoseconds(TICK_S))
    events = [(int(t), "on_state", n) for n, t in enumerate(heard)]
    events += [(int(t), "on_command", n) for n, t in enumerate(sent)]
    events += [(t, "on_tick", n) for n, t in enumerate(ticks)]
    found: dict[str, str] = {}
    for now_ns, what, n in sorted(events):
        arguments: tuple = (now_ns,)
        if what == "on_state":
            stamp_ns = int(stamps[n])
            arguments = JointState(stamp_ns, q[n], estimator.update(stamp_ns, q[n])), now_ns
        elif what == "on_command":
            arguments = JointCommand(now_ns, "log", n, now_ns, values[n]), now_ns
        for name, rule in rules.items():
            said = getattr(rule, what)(*arguments)
            if said is not None:
                found.setdefault(name, said)
    return found


def reasons(entry: LogEntry, machine: MachineSpecification) -> set[str]:
    """Rules that a bag gives a reason, by its arrays: gaps, and readings that repeat under command."""
    raw = read_log(entry, machine)
    heard, q, sent, a = map(as_array, (raw.joint_log_time_ns, raw.q, raw.command_log_time_ns, raw.command))
    found = set()
    for name, times, longest_s in (
        ("state_frequency", heard, CONFIG.maximum_state_gap_s),
        ("command_frequency", sent, CONFIG.maximum_command_gap_s),
    ):
        if np.diff(times).max() / NANOSECONDS > longest_s:
            found.add(name)
    in_force = a[np.maximum(np.searchsorted(sent, heard, side="right") - 1, 0)]
    margin = CONFIG.limit_tolerance * (machine.upper - machine.lower)
    is_inside = (q > machine.lower + margin) & (q < machine.upper - margin)
    stands = (np.diff(q, axis=0) == 0) & (np.abs(in_force[:-1]) >= CONFIG.frozen_command) & is_inside[:-1]
    for joint in stands.T:
        edges = np.flatnonzero(np.diff(np.concatenate([[0], joint.astype(int), [0]])))
        lengths_s = (heard[edges[1::2]] - heard[edges[::2]]) / NANOSECONDS
        if lengths_s.max(initial=0.0) > CONFIG.frozen_after_s:
            found.add("frozen_encoder")
    if machine.workspace is not None:
        reference = load_arm(machine, MACHINE_DIRECTORY)
        is_in = np.asarray(contains(machine.workspace, reference.forward(q).position, reference.yaw(q)))
        if (is_in[:-2] & ~is_in[1:-1] & ~is_in[2:]).any():  # for longer than a tick
            found.add("envelope")
    return found


@pytest.mark.parametrize(
    "bag",
    [pytest.param(bag, id=bag.name, marks=[] if bag.name == SHORT else [pytest.mark.long]) for bag in BAGS],
)
def test_a_real_bag_is_objected_to_where_it_shows_a_reason(bag: Path) -> None:
    machine = load_machine("rc_excavator")
    (entry,) = find_logs(bag)
    names = [name for name in RULES if name not in OF_AN_ARM]
    assert set(objections(entry, machine, names)) == reasons(entry, machine)


def test_a_bag_of_the_simulated_machine_is_objected_to_where_the_operator_leaves_the_envelope(
    tmp_path: Path,
) -> None:
    machine = load_machine("bobcat_e10")
    log = record_session(machine, simulated_machine(machine.name), draw_style(0), 1.0, 0, 10 * NANOSECONDS)
    write_session(tmp_path / "bag", machine, log)
    (entry,) = find_logs(tmp_path)
    assert set(objections(entry, machine, list(RULES))) == reasons(entry, machine) == {"envelope"}
