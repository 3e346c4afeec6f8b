"""What components keep of stops, say of them, and learn of lost ones."""

import dataclasses

import numpy as np

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.deployment.component import Publication, nanoseconds
from pipeline.deployment.components.control_interface import ControlInterface
from pipeline.deployment.components.stop_latch import StopLatch
from pipeline.deployment.components.supervision.control_supervisor import ControlSupervisor, supervise
from pipeline.deployment.messages import (
    EmergencyStop,
    JointCommand,
    JointState,
    Level,
    MachineCommand,
    Release,
    SupervisorState,
    Topic,
)
from tests.deployment.components.test_reset import CONFIG, MACHINE, Graph

SILENCE, LAST, RULE = "supervisor's silence, s", "last stop", "rule command_value"
OLD = "joint state is 0.100 s old"
DETAIL = "command [2.0, 0.0, 0.0, 0.0] of server"


def test_a_latch_knows_the_latest_stop_and_release_in_any_order() -> None:
    latch = StopLatch()
    assert not latch.is_closed and latch.later_than_known(0) == 0
    latch.hear(EmergencyStop(0, "first", ""))
    assert latch.is_closed and latch.closings == 1
    latch.hear(EmergencyStop(5, "second", ""))
    for again in (EmergencyStop(5, "again", ""), EmergencyStop(4, "former", ""), SupervisorState(9, "")):
        latch.hear(again)
    assert latch.last is not None and latch.last.rule == "second" and latch.closings == 2
    assert [latch.later_than_known(now_ns) for now_ns in (3, 9)] == [6, 9]
    latch.hear(Release(0, 4))
    assert latch.is_closed
    latch.hear(Release(0, 7))
    latch.hear(Release(0, 5))
    latch.hear(EmergencyStop(6, "late", ""))
    assert not latch.is_closed and latch.closings == 3 and latch.later_than_known(3) == 8


def test_an_interface_learns_of_a_lost_stop_from_the_sign_of_life() -> None:
    interface = ControlInterface(MACHINE, CONFIG.interface)
    assert interface.period_ns == nanoseconds(CONFIG.interface.period_s)
    interface.on_message(Topic.supervisor_state, SupervisorState(10, ""), 11)
    command = JointCommand(12, "server", 1, 12, np.ones(4, np.float32))
    (forwarded,) = interface.on_message(Topic.requested_commands, command, 12)
    assert forwarded.topic is Topic.joint_commands and forwarded.message.stamp_ns == 12
    (zero,) = interface.on_message(Topic.supervisor_state, SupervisorState(20, "joint_limits", 18), 21)
    (repeated,) = interface.on_timer(30)
    for output, now_ns in ((zero, 21), (repeated, 30)):
        assert isinstance(output, Publication) and isinstance(output.message, MachineCommand)
        assert output.topic is Topic.joint_commands and output.message.stamp_ns == now_ns
        assert output.message.values.dtype == np.float32 and not output.message.values.any()
    assert interface.condition(30).text == "stopped by joint_limits: signal lost"
    interface.on_message(Topic.release, Release(40, 18), 40)
    assert interface.on_message(Topic.emergency_stop, EmergencyStop(18, "joint_limits", ""), 41) == ()
    assert not interface.is_muted


def test_conditions_tell_what_is_waited_for() -> None:
    fresh, graph = ControlInterface(MACHINE, CONFIG.interface), Graph()
    assert fresh.condition(0) == (
        Level.warning,
        "waits for the supervisor",
        {SILENCE: "none heard", LAST: "none"},
    )
    later_ns = graph.now_ns + nanoseconds(0.02)
    values = {SILENCE: "0.020", LAST: "none"}
    assert graph.interface.condition(later_ns) == (Level.ok, "passes commands on", values)
    values = {RULE: "no objection", LAST: "none"}
    assert graph.supervisor.condition(later_ns) == (Level.ok, "no objection", values)
    graph.happen("violation")
    text = f"stopped by command_value: {DETAIL}"
    values = {RULE: f"stopped: {DETAIL}", LAST: f"command_value: {DETAIL}"}
    assert graph.supervisor.condition(later_ns) == (Level.error, text, values)
    graph.happen("acknowledge")
    text = f"acknowledged, waits for neutral sticks; {text}"
    assert graph.supervisor.condition(later_ns) == (Level.error, text, {**values, RULE: values[RULE]})


def test_a_rule_that_only_warns_is_told_and_stops_nothing() -> None:
    rules = dataclasses.replace(CONFIG.supervisor, warnings=["command_value"])
    supervisor = supervise(MACHINE, dataclasses.replace(CONFIG, supervisor=rules), MACHINE_DIRECTORY)
    command = JointCommand(1, "server", 1, 1, np.array([2.0, 0, 0, 0]))
    assert supervisor.on_message(Topic.requested_commands, command, 1) == ()
    values = {RULE: f"warned: {DETAIL}", LAST: "none"}
    assert supervisor.condition(2) == (Level.warning, "warned by command_value", values)
    (sign,) = supervisor.on_timer(3)
    assert sign == Publication(Topic.supervisor_state, SupervisorState(3, "", 0))


def supervisor_of(rule: str) -> ControlSupervisor:
    rules = dataclasses.replace(CONFIG.supervisor, rules=[rule])
    return supervise(MACHINE, dataclasses.replace(CONFIG, supervisor=rules), MACHINE_DIRECTORY)


def test_a_stop_is_stamped_with_the_moment_of_its_reason() -> None:
    supervisor = supervisor_of("command_frequency")
    assert supervisor.period_ns == nanoseconds(CONFIG.supervisor.period_s)
    supervisor.on_message(Topic.requested_commands, JointCommand(1, "server", 1, 1, np.zeros(4)), 1)
    now_ns = 2 + nanoseconds(CONFIG.supervisor.maximum_command_gap_s)
    stop, sign = supervisor.on_timer(now_ns)
    assert stop.topic is Topic.emergency_stop and stop.message.stamp_ns == now_ns
    assert sign.message == SupervisorState(now_ns, "command_frequency", now_ns)

    state = JointState(1, np.zeros(4), np.zeros(4))
    now_ns = 2 + nanoseconds(CONFIG.supervisor.maximum_state_delay_s)
    (stop,) = supervisor_of("state_frequency").on_message(Topic.joint_states, state, now_ns)
    assert stop == Publication(Topic.emergency_stop, EmergencyStop(now_ns, "state_frequency", OLD))


def test_a_command_makes_the_neutral_time_begin_anew() -> None:
    graph = Graph()
    for event in ("violation", "acknowledge", "tick", "command", "tick"):
        graph.happen(event)
    assert graph.interface.is_muted
    graph.happen("tick")
    assert not graph.interface.is_muted
