"""The rules as arrays object exactly when the components do, on a recording with faults of every kind."""

import dataclasses

import numpy as np

from benchmarks.rule_arrays import TRACKER, Heard, Parts, objections
from pipeline.configuration.load import MACHINE_DIRECTORY, load_machine, load_section
from pipeline.deployment.component import NANOSECONDS, nanoseconds
from pipeline.deployment.components.supervision.supervisor_rules import RuleParts, build_rules
from pipeline.deployment.components.velocity_estimator import VelocityEstimator
from pipeline.deployment.messages import JointCommand, JointState
from pipeline.deployment.settings import DeploymentConfig
from pipeline.plant.machines.simulated import simulated_machine
from pipeline.plant.recording.operator import draw_style
from pipeline.plant.recording.session import record_session

MACHINE = load_machine("bobcat_e10")
CONFIG = load_section("deployment", DeploymentConfig, "default").supervisor


def driven() -> Heard:
    """A minute of driving, in which nothing is sound."""
    log = record_session(MACHINE, simulated_machine(MACHINE.name), draw_style(3), 1.0, 3, 10 * NANOSECONDS)
    stamps, state_ns, q = (
        of.copy() for of in (log.joint_state_header_stamp_ns, log.joint_state_log_time_ns, log.positions)
    )
    sent_ns, a = log.command_log_time_ns.copy(), log.commands.astype(float)
    command_ns = sent_ns + np.random.default_rng(0).integers(nanoseconds(0.004), size=len(sent_ns))
    command_ns[100:110] += nanoseconds(0.045)  # late
    a[200:280, 1] = 1.0
    rows = (state_ns > command_ns[200]) & (state_ns < command_ns[270])
    q[rows, 1] = q[rows, 1][0]  # stands under command
    a[400:560, 2] = -1.0
    rows = (state_ns > command_ns[410]) & (state_ns < command_ns[550])
    q[rows, 2] = MACHINE.lower[2]  # is pressed into its end stop
    q[500:520, 0] = np.linspace(MACHINE.upper[0], MACHINE.upper[0] + 0.3, 20)  # beyond a limit
    q[700] += 0.3  # jumps
    q[2200:2300] = np.array([0.9, -0.9, 0.0, 0.0]) + 1e-4 * np.arange(100)[:, None]  # folded
    stamps[900] = stamps[899]
    stamps[950] -= nanoseconds(0.11)
    kept, sent = np.ones(len(q), bool), np.ones(len(a), bool)
    kept[1000:1010] = sent[600:604] = False
    more_ns = sent_ns[700] + np.arange(15) * nanoseconds(0.001) + nanoseconds(0.01)
    order = np.argsort(np.concatenate([command_ns[sent], more_ns]), kind="stable")
    return Heard(
        stamps[kept],
        state_ns[kept],
        q[kept],
        np.concatenate([sent_ns[sent], more_ns])[order],
        np.concatenate([command_ns[sent], more_ns])[order],
        np.concatenate([a[sent], np.zeros((15, 4))])[order],
    )


def test_arrays_object_when_the_components_do() -> None:
    heard = driven()
    parts = RuleParts(MACHINE, CONFIG, MACHINE_DIRECTORY)
    found = objections(Parts(MACHINE, CONFIG, parts.shapes, parts.envelope), heard)
    rules = build_rules(dataclasses.replace(parts, config=dataclasses.replace(CONFIG, rules=list(found))))
    estimator = VelocityEstimator(nanoseconds(MACHINE.dt_s), TRACKER)
    ticks = range(heard.state_ns[0], heard.state_ns[-1], nanoseconds(CONFIG.period_s))
    events = [(t, "on_command", n) for n, t in enumerate(heard.command_ns.tolist())]
    events += [(t, "on_state", n) for n, t in enumerate(heard.state_ns.tolist())]
    events += [(t, "on_tick", n) for n, t in enumerate(ticks)]
    said: dict[str, list[int]] = {name: [] for name in rules}
    for now_ns, what, n in sorted(events):
        message: tuple = ()
        if what == "on_command":
            sent_ns = int(heard.sent_ns[n])
            message = (JointCommand(sent_ns, "log", n, sent_ns, heard.a[n]),)
        elif what == "on_state":
            stamp_ns = int(heard.stamp_ns[n])
            message = (JointState(stamp_ns, heard.q[n], estimator.update(stamp_ns, heard.q[n])),)
        for name, rule in rules.items():
            if getattr(rule, what)(*message, now_ns) is not None:
                said[name].append(now_ns)
    for name, times_ns in said.items():
        assert times_ns, name  # each has a reason here
        np.testing.assert_array_equal(found[name], times_ns, name)
