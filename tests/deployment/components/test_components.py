"""Servers, interface, drivers and estimator, each by itself."""

import dataclasses

import can
import numpy as np
import pytest

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.deployment.component import Computation, Publication, nanoseconds
from pipeline.deployment.components.control_interface import ControlInterface
from pipeline.deployment.components.goals import compiled_forward
from pipeline.deployment.components.state_buffers import StateBuffers
from pipeline.deployment.components.teleoperation_server import TeleoperationServer
from pipeline.deployment.components.termination import OscillationWatch, TerminalConditions
from pipeline.deployment.drivers.bobcat_e10_sim_driver import SimulationDriver
from pipeline.deployment.drivers.can_frames import CanFrames
from pipeline.deployment.drivers.programmable_controller import ProgrammableController
from pipeline.deployment.messages import (
    CancelGoal,
    EmergencyStop,
    GoalOutcome,
    JointCommand,
    JointState,
    Joystick,
    MachineCommand,
    ReachGoal,
    ReachResult,
    Release,
    SupervisorState,
    TargetPose,
    Topic,
)
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.errors import InputError
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.tracked_velocities import track
from tests.deployment.machines import (
    MIDDLE,
    BackAndForth,
    Integrator,
    arm,
    bobcat,
    estimator,
    paper,
    server,
    specification,
    supervised,
)

PERIOD_NS = nanoseconds(0.05)
GOAL = ReachGoal(1, np.zeros(3), np.array([1.0, 0, 0, 0]))


class Harness:
    """A server, fed with joint states; computations are carried out at once."""

    def __init__(self, ticks: int = 500) -> None:
        self.controller = BackAndForth()
        self.server = server(self.controller, ticks)
        self.now_ns = 0
        self.sent: list = []

    def take(self, outputs) -> None:
        for output in outputs:
            if isinstance(output, Computation):
                self.take(self.server.on_computed(self.server.compute(output.request), self.now_ns))
            else:
                self.sent.append(output.message)

    def message(self, topic: Topic, message) -> None:
        self.take(self.server.on_message(topic, message, self.now_ns))

    def tick(self, n: int = 1, q=MIDDLE) -> None:
        for _ in range(n):
            self.now_ns += PERIOD_NS
            self.message(Topic.joint_states, JointState(self.now_ns, np.array(q), np.zeros(4)))
            self.take(self.server.on_timer(self.now_ns))

    def of(self, kind) -> list:
        return [message for message in self.sent if isinstance(message, kind)]


def test_a_goal_is_pursued_tick_by_tick_until_the_time_out() -> None:
    harness = Harness(ticks=20)
    harness.tick(3)
    assert harness.sent == []
    harness.message(Topic.goal, GOAL)
    harness.tick(30)
    (result,) = harness.of(ReachResult)
    assert (result.outcome, result.n_ticks) == (GoalOutcome.timed_out, 20)
    commands = harness.of(JointCommand)
    assert len(commands) == 21 and [c.sequence for c in commands] == list(range(1, 22))
    assert [c.is_last for c in commands] == [False] * 20 + [True]
    assert not commands[-1].values.any() and commands[0].values.any()
    # four ticks per decision: commands of a group were decided on the same joint state
    assert len({c.observed_ns for c in commands[:-1]}) == 5
    assert len(harness.of(TargetPose)) == 1 and harness.controller.n_begun == 1


@pytest.mark.parametrize(
    ("event", "outcome"),
    [
        (lambda h: h.message(Topic.cancel, CancelGoal(1)), GoalOutcome.cancelled),
        (lambda h: h.message(Topic.emergency_stop, EmergencyStop(0, "rule", "")), GoalOutcome.stopped),
        (lambda h: setattr(h.controller, "values", np.full(4, np.nan)), GoalOutcome.controller_failed),
        (lambda h: setattr(h.controller, "values", np.full(4, 0.5)), GoalOutcome.controller_failed),
        (lambda h: setattr(h.controller, "values", np.ones(3)), GoalOutcome.controller_failed),
        (lambda h: h.message(Topic.goal, dataclasses.replace(GOAL, goal_id=2)), GoalOutcome.cancelled),
    ],
)
def test_a_goal_ends_early(event, outcome: GoalOutcome) -> None:
    harness = Harness()
    harness.tick()
    harness.message(Topic.goal, GOAL)
    harness.tick(6)
    event(harness)
    harness.tick(6)
    assert harness.of(ReachResult)[0].outcome is outcome


def test_an_unreachable_pose_is_refused_and_the_goal_in_hand_goes_on() -> None:
    harness = Harness()
    harness.tick()
    harness.message(Topic.goal, GOAL)
    harness.tick(4)
    harness.message(Topic.goal, ReachGoal(2, np.full(3, np.nan), GOAL.quaternion))
    harness.tick(4)
    assert [(r.goal_id, r.outcome) for r in harness.of(ReachResult)] == [(2, GoalOutcome.refused)]
    assert not harness.of(JointCommand)[-1].is_last


def test_nothing_is_pursued_after_an_emergency_stop() -> None:
    harness = Harness()
    harness.tick()
    harness.message(Topic.emergency_stop, EmergencyStop(0, "rule", ""))
    harness.message(Topic.goal, GOAL)
    harness.tick(10)
    assert [r.outcome for r in harness.of(ReachResult)] == [GoalOutcome.stopped]
    assert harness.of(JointCommand) == []


def test_a_release_begins_no_goal_from_before_it() -> None:
    harness = Harness()
    harness.tick()
    harness.server.on_message(Topic.goal, GOAL, harness.now_ns)
    (solving,) = harness.server.on_timer(harness.now_ns)
    for message in (EmergencyStop(7, "rule", ""), Release(8, 6), Release(9, 7)):
        harness.message(Topic.release, message)
    harness.take(harness.server.on_computed(harness.server.compute(solving.request), harness.now_ns))
    harness.tick(10)
    assert [r.outcome for r in harness.of(ReachResult)] == [GoalOutcome.stopped]
    assert harness.of(JointCommand) == []
    harness.message(Topic.goal, GOAL)
    harness.tick(4)
    assert harness.of(JointCommand)


def conditions(**changes) -> TerminalConditions:
    return TerminalConditions(bobcat(), arm(), dataclasses.replace(paper().termination, **changes))


def test_a_goal_is_reached_within_its_tolerances_only() -> None:
    pose = compiled_forward(arm())(MIDDLE)
    watch = conditions(at_goal=True).begin(np.asarray(pose.position), np.asarray(pose.quaternion))
    assert watch.check(MIDDLE, np.zeros(4), 0) is GoalOutcome.reached
    assert watch.check(MIDDLE + np.array([0, 0, 0, 0.1]), np.zeros(4), 0) is None  # 0.1 rad of pitch
    assert watch.check(MIDDLE + np.array([0.2, 0, 0, 0]), np.zeros(4), 0) is None  # some 0.4 m
    assert conditions().begin(pose.position, pose.quaternion).check(MIDDLE, np.zeros(4), 0) is None


def test_leaving_the_workspace_takes_having_been_inside() -> None:
    outside = np.array([0.0, -0.6, -0.5, 0.0])
    watch = conditions(outside_workspace=True).begin(np.zeros(3), GOAL.quaternion)
    assert watch.check(outside, np.zeros(4), 0) is None
    assert watch.check(MIDDLE, np.zeros(4), 0) is None
    assert watch.check(outside, np.zeros(4), 0) is GoalOutcome.left_workspace


def test_oscillation_is_many_reversals_within_the_window() -> None:
    def reversals_noticed(period_s: float) -> bool:
        watch = OscillationWatch(2.0, 6, 4)
        signs = [1 if n % 2 else -1 for n in range(20)]
        return any(
            watch.oscillates(np.array([s, 0, 0, 0]), nanoseconds(n * period_s)) for n, s in enumerate(signs)
        )

    assert reversals_noticed(0.2) and not reversals_noticed(0.5)
    pauses = OscillationWatch(2.0, 1, 1)
    assert not any(pauses.oscillates(np.array([s]), n) for n, s in enumerate([1, 0, 1, 0, 1]))
    assert pauses.oscillates(np.array([-1]), 9)  # after a pause too


@pytest.mark.parametrize("target", Target)
def test_buffers_are_those_of_learning(target: Target) -> None:
    """Against the model's own history: at rest in the beginning, and after some rows."""
    from pipeline.dynamics.model.dynamics_model import DynamicsModel

    rows = np.random.default_rng(0).normal(size=(8, 3, 4)).astype(np.float32)
    model, buffers = DynamicsModel(specification(target=target)), StateBuffers(specification(target=target))
    buffers.push(rows[0, 0], np.zeros(4, np.float32), np.zeros(4, np.float32))
    rest = model.initial_history(rows[0, 0])
    np.testing.assert_array_equal(buffers.motion, rest.motion)
    np.testing.assert_array_equal(buffers.commands, rest.commands)
    for t in range(1, 8):
        buffers.push(rows[t, 0], rows[t, 1], rows[t - 1, 2])
    logged = model.history_from_rows(rows[:, 0], rows[:, 1], rows[:, 2])
    np.testing.assert_array_equal(buffers.motion, logged.motion)
    np.testing.assert_array_equal(buffers.commands, logged.commands)


def test_the_joystick_is_discretised_and_silence_releases_it() -> None:
    config = paper().teleoperation
    teleoperation = TeleoperationServer(bobcat(), config)
    axes = np.zeros(6)
    axes[config.axes] = np.array([0.6, -0.5, 0.51, -1.0]) * config.signs
    teleoperation.on_message(Topic.joystick, Joystick(0, axes), 0)
    (sent,) = teleoperation.on_timer(PERIOD_NS)
    np.testing.assert_array_equal(sent.message.values, [1, 0, 1, -1])
    later = nanoseconds(config.maximum_silence_s) + 1
    (last,) = teleoperation.on_timer(later)
    assert last.message.is_last and not last.message.values.any()
    assert teleoperation.on_timer(later + PERIOD_NS) == ()
    teleoperation.on_message(Topic.joystick, Joystick(0, np.full(2, 1.0)), later)
    assert not teleoperation.command(later).any()  # of another device
    with pytest.raises(InputError, match=r"teleoperation\.axes has 1 entries"):
        TeleoperationServer(bobcat(), dataclasses.replace(config, axes=[0], signs=[1.0]))


def test_a_machine_of_fewer_joints_takes_the_first_of_the_sticks() -> None:
    config = paper().teleoperation
    two_joints = dataclasses.replace(bobcat(), joints=bobcat().joints[:2])
    teleoperation = TeleoperationServer(two_joints, config)
    axes = np.zeros(6)
    axes[config.axes] = [config.signs[0], 0.0, 1.0, 1.0]
    teleoperation.on_message(Topic.joystick, Joystick(0, axes), 0)
    np.testing.assert_array_equal(teleoperation.command(0), [1, 0])


def requested(values) -> JointCommand:
    return JointCommand(0, "server", 1, 0, np.array(values, float))


def test_the_interface_mutes_from_the_emergency_on() -> None:
    interface = ControlInterface(bobcat(), paper().interface)
    (passed,) = interface.on_message(Topic.requested_commands, requested([1, 0, 0, 0]), 0)
    assert passed.message.values.tolist() == [1, 0, 0, 0]
    (zero,) = interface.on_message(Topic.emergency_stop, EmergencyStop(0, "rule", ""), 1)
    assert not zero.message.values.any()
    assert interface.on_message(Topic.requested_commands, requested([1, 0, 0, 0]), 2) == ()
    (still,) = interface.on_timer(3)
    assert not still.message.values.any()


def test_a_supervised_interface_wants_a_sign_of_life() -> None:
    config = supervised().interface
    interface = ControlInterface(bobcat(), config)
    interface.on_message(Topic.supervisor_state, SupervisorState(0, ""), 0)
    limit_ns = nanoseconds(config.maximum_supervisor_silence_s)
    assert interface.on_timer(limit_ns) == ()
    interface.on_timer(limit_ns + 1)
    assert interface.is_muted
    unheard = ControlInterface(bobcat(), config)
    unheard.on_message(Topic.requested_commands, requested([1, 0, 0, 0]), 0)
    assert unheard.is_muted


def test_velocities_are_those_of_the_contract() -> None:
    """Readings at odd times between rows of a broken line, against the batch tracker on the rows."""
    rows = np.cumsum(np.random.default_rng(1).normal(0, 0.02, (30, 4)), axis=0)
    row_ns = PERIOD_NS * np.arange(30)
    times = np.union1d(row_ns, row_ns[:-1] + nanoseconds(0.017))
    tracker = estimator()
    for time_ns in times:
        q = np.array([np.interp(time_ns, row_ns, rows[:, j]) for j in range(4)])
        velocity = tracker.update(int(time_ns), q)
        assert (tracker.update(int(time_ns), q + 1.0) == velocity).all()  # the same stamp again
    np.testing.assert_allclose(velocity, track(rows, 0.05, LoopTrackerConfig(10.0, 60.0))[-1], atol=1e-12)


def test_the_simulation_driver_holds_commands_and_zeroes_stale_ones() -> None:
    machine = Integrator(noise=0.0)
    config = paper().driver
    driver = SimulationDriver(machine, 4, config, estimator())
    (first,) = driver.on_timer(0)
    assert isinstance(first, Publication) and (first.message.position == MIDDLE).all()
    driver.on_message(Topic.joint_commands, MachineCommand(0, np.array([1, 0, 0, 0])), 0)
    for n in range(40):
        driver.on_timer(n * machine.period_ns)
    moved_s = (machine.q[0] - MIDDLE[0]) / 0.2
    assert moved_s == pytest.approx(config.command_timeout_s, abs=0.021)


def test_frames_come_back_as_they_went() -> None:
    frames = CanFrames(bobcat(), MACHINE_DIRECTORY)
    values = np.array([-1.0, 0.0, 1.0, -1.0])
    np.testing.assert_array_equal(frames.read_command(frames.command(values, 300, 5)), values)
    frame = frames.encoders(MIDDLE, 5)
    np.testing.assert_allclose(frames.read_encoders(frame), MIDDLE, atol=np.pi / 65536)
    assert frames.read_command(frame) is None
    assert frames.read_encoders(dataclasses.replace(frame, data=b"\0")) is None
    assert frames.is_emergency(frames.emergency(0)) and not frames.is_emergency(frame)


@pytest.mark.parametrize("emergency", [True, False])
def test_the_plc_holds_its_set_point_and_zeroes_it(emergency: bool) -> None:
    config, frames = paper().driver, CanFrames(bobcat(), MACHINE_DIRECTORY)
    with can.Bus("plc", interface="virtual") as host, can.Bus("plc", interface="virtual") as far:
        plc = ProgrammableController(far, frames, Integrator(), 4, config)

        def send(frame) -> None:
            host.send(can.Message(arbitration_id=frame.identifier, data=frame.data, is_extended_id=False))

        send(frames.command(np.array([1, 0, 0, -1]), 1, 0))
        cycle_ns = plc.period_ns
        plc.on_timer(0)
        if emergency:
            send(frames.emergency(0))
        moving = []
        for n in range(1, 40):
            plc.on_timer(n * cycle_ns)
            moving.append(bool(plc.output.any()))
        held_s = sum(moving) * cycle_ns * 1e-9
        assert held_s == pytest.approx(0.0 if emergency else config.command_timeout_s, abs=1e-9)
        send(frames.command(np.array([1, 0, 0, 0]), 2, 0))
        plc.on_timer(40 * cycle_ns)
        assert bool(plc.output.any()) is not emergency  # an emergency lasts, ...
        release = frames.release(0)
        for n, (frame, moves) in enumerate(
            [
                (dataclasses.replace(release, data=b"\0"), not emergency),
                (frames.command(np.array([1, 0, 0, 0]), 3, 0), not emergency),
                (release, False),  # ... until the exact frame ends it, with outputs at rest
                (frames.command(np.array([1, 0, 0, 0]), 4, 0), True),
            ]
        ):
            send(frame)
            plc.on_timer((41 + n) * cycle_ns)
            assert bool(plc.output.any()) == moves


def test_a_machine_without_frames_is_told_so(tmp_path) -> None:
    with pytest.raises(InputError, match=r"bobcat_e10\.dbc: no such file"):
        CanFrames(bobcat(), tmp_path)
    (tmp_path / "bobcat_e10.dbc").write_text(
        'VERSION "1"\n\nBO_ 1 EMERGENCY: 1 A\n SG_ stop : 0|1@1+ (1,0) [0|1] "" B\n'
    )
    with pytest.raises(InputError, match="no frame 'COMMAND'"):
        CanFrames(bobcat(), tmp_path)


def test_the_interface_s_own_stops_say_when_by_which_rule_and_why() -> None:
    config = supervised().interface
    late_ns = nanoseconds(config.maximum_supervisor_silence_s) + 2
    wrong = JointCommand(1, "rogue", 1, 1, np.full(4, 2.0))
    for rule, detail, happens in (
        ("supervisor_silence", "no sign of life of the supervisor", lambda i: i.on_timer(late_ns)),
        (
            "invalid_command",
            "command [2.0, 2.0, 2.0, 2.0] of rogue",
            lambda i: i.on_message(Topic.requested_commands, wrong, late_ns),
        ),
    ):
        interface = ControlInterface(bobcat(), config)
        alive_ns = 1 if rule == "supervisor_silence" else late_ns
        interface.on_message(Topic.supervisor_state, SupervisorState(alive_ns, ""), alive_ns)
        stop, zeros = happens(interface)
        assert stop == Publication(Topic.emergency_stop, EmergencyStop(late_ns, rule, detail))
        assert zeros.topic is Topic.joint_commands and zeros.message.stamp_ns == late_ns
        assert not zeros.message.values.any()
