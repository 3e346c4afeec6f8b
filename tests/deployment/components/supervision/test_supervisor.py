"""The supervisor's rules, each against the property that it stands for."""

import dataclasses
import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.deployment.component import Publication, nanoseconds
from pipeline.deployment.components.supervision.control_supervisor import supervise
from pipeline.deployment.components.supervision.self_collision import SelfCollision
from pipeline.deployment.components.supervision.supervisor_rules import (
    CommandDelay,
    CommandFrequency,
    CommandOrder,
    CommandValue,
    EncoderReading,
    FrozenEncoder,
    JointLimits,
    RuleParts,
    StateFrequency,
    build_rules,
)
from pipeline.deployment.messages import (
    EmergencyStop,
    JointCommand,
    JointState,
    Joystick,
    Release,
    Reset,
    Topic,
)
from pipeline.errors import InputError
from tests.deployment.machines import MIDDLE, bobcat, paper, supervised

CONFIG = paper().supervisor
LOWER, UPPER = bobcat().lower, bobcat().upper
RANGE = UPPER - LOWER


def command(
    stamp_s: float = 0.0, sequence: int = 1, values=(1, 0, 0, 0), is_last: bool = False, observed_s=None
):
    observed_ns = nanoseconds(stamp_s if observed_s is None else observed_s)
    return JointCommand(
        nanoseconds(stamp_s), "server", sequence, observed_ns, np.array(values, float), is_last
    )


def state(stamp_s: float, position=MIDDLE, velocity=(0, 0, 0, 0)) -> JointState:
    return JointState(nanoseconds(stamp_s), np.array(position, float), np.array(velocity, float))


def parts(*rules: str) -> RuleParts:
    return RuleParts(bobcat(), dataclasses.replace(CONFIG, rules=list(rules)), MACHINE_DIRECTORY)


@given(st.lists(st.floats(0.001, 0.4), min_size=1, max_size=20))
def test_silence_is_noticed_exactly_beyond_the_longest_gap(gaps: list[float]) -> None:
    rule, now = CommandFrequency(CONFIG), 1.0
    rule.on_command(command(), nanoseconds(now))
    for gap in gaps:
        objection = rule.on_tick(nanoseconds(now + gap))
        assert (objection is not None) == (
            nanoseconds(now + gap) - nanoseconds(now) > nanoseconds(CONFIG.maximum_command_gap_s)
        )
        now += gap
        rule.on_command(command(), nanoseconds(now))


@given(st.integers(1, 60))
def test_too_many_commands_are_noticed(rate_hz: int) -> None:
    rule = CommandFrequency(CONFIG)
    heard = [rule.on_command(command(), nanoseconds(1.0 + n / rate_hz)) for n in range(3 * rate_hz)]
    assert any(heard) == (rate_hz > CONFIG.maximum_command_rate_hz)


def test_a_server_that_said_its_last_word_may_be_silent() -> None:
    rule = CommandFrequency(CONFIG)
    rule.on_command(command(is_last=True), 0)
    assert rule.on_tick(nanoseconds(100.0)) is None


@given(st.floats(-0.5, 0.5), st.floats(0.0, 1.0))
def test_delays_are_bounded_on_both_sides(delay_s: float, age_s: float) -> None:
    now_ns = nanoseconds(10.0)
    sent = command(10.0 - delay_s, observed_s=10.0 - age_s)
    delay_ns, age_ns = now_ns - sent.stamp_ns, now_ns - sent.observed_ns
    fine = -nanoseconds(CONFIG.clock_tolerance_s) <= delay_ns <= nanoseconds(CONFIG.maximum_command_delay_s)
    fine &= age_ns <= nanoseconds(CONFIG.maximum_decision_age_s)
    assert (CommandDelay(CONFIG).on_command(sent, now_ns) is None) == fine


@given(st.lists(st.integers(1, 6), min_size=1, max_size=8))
def test_only_consecutive_commands_are_in_order(sequences: list[int]) -> None:
    rule = CommandOrder()
    heard = [rule.on_command(command(sequence=number), 0) for number in sequences]
    assert (not any(heard)) == all(b == a + 1 for a, b in itertools.pairwise(sequences))


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True, width=32), min_size=0, max_size=6))
def test_only_minus_one_zero_and_one_per_joint_are_commands(values: list[float]) -> None:
    fine = len(values) == bobcat().n_joint and set(values) <= {-1.0, 0.0, 1.0}
    assert (CommandValue(bobcat()).on_command(command(values=values), 0) is None) == fine


@given(st.lists(st.floats(0.001, 0.3), min_size=2, max_size=20), st.floats(-0.05, 0.2))
def test_joint_states_come_in_order_in_time_and_often(gaps: list[float], delay_s: float) -> None:
    rule, now = StateFrequency(CONFIG), 1.0
    earliest_s, latest_s = -CONFIG.clock_tolerance_s, CONFIG.maximum_state_delay_s
    for gap in gaps:
        heard = rule.on_state(state(now - delay_s), nanoseconds(now))
        if min(abs(delay_s - earliest_s), abs(delay_s - latest_s)) > 1e-6:
            assert (heard is None) == (earliest_s < delay_s < latest_s)
        if abs(gap - CONFIG.maximum_state_gap_s) > 1e-6:
            assert (rule.on_tick(nanoseconds(now + gap)) is not None) == (gap > CONFIG.maximum_state_gap_s)
        now += gap
    assert rule.on_state(state(now - gaps[-1] - delay_s - 0.01), nanoseconds(now)) is not None


@given(st.integers(0, 3), st.floats(-1.0, 1.0), st.floats(0.005, 0.1))
def test_a_jump_is_what_no_joint_can_do(joint: int, step: float, dt_s: float) -> None:
    rule = EncoderReading(bobcat(), CONFIG)
    rule.on_state(state(1.0), 0)
    moved = MIDDLE.copy()
    moved[joint] += step
    allowed = (CONFIG.jump_tolerance + CONFIG.maximum_speed * dt_s) * RANGE[joint]
    if abs(abs(step) - allowed) > 1e-6:
        assert (rule.on_state(state(1.0 + dt_s, moved), 0) is not None) == (abs(step) > allowed)


@given(st.integers(0, 3), st.sampled_from([np.nan, np.inf, -np.inf]), st.booleans())
def test_readings_are_finite(joint: int, value: float, in_velocity: bool) -> None:
    position, velocity = MIDDLE.copy(), np.zeros(4)
    (velocity if in_velocity else position)[joint] = value
    assert EncoderReading(bobcat(), CONFIG).on_state(state(1.0, position, velocity), 0) is not None


@pytest.mark.parametrize(
    ("commanded", "moves", "objects"), [(1, False, True), (0, False, False), (1, True, False)]
)
def test_a_frozen_encoder_is_one_of_a_commanded_joint(commanded: int, moves: bool, objects: bool) -> None:
    rule = FrozenEncoder(bobcat(), CONFIG)
    heard = []
    for n in range(100):
        now_ns = nanoseconds(n * 0.05)
        rule.on_command(command(values=(commanded, 0, 0, 0)), now_ns)
        rule.on_state(state(n * 0.05, MIDDLE + (1e-6 * n if moves else 0.0)), now_ns)
        heard.append(rule.on_tick(now_ns))
    assert any(heard) == objects


@pytest.mark.parametrize("stop", [LOWER, UPPER], ids=["lower", "upper"])
def test_an_arm_at_its_end_stop_is_not_frozen(stop: np.ndarray) -> None:
    rule = FrozenEncoder(bobcat(), CONFIG)
    for n in range(100):
        rule.on_command(command(values=(-1, -1, -1, -1)), nanoseconds(n * 0.05))
        rule.on_state(state(n * 0.05, stop), nanoseconds(n * 0.05))
        assert rule.on_tick(nanoseconds(n * 0.05)) is None


@given(
    st.lists(st.floats(-0.2, 1.2), min_size=4, max_size=4),
    st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4),
    st.sampled_from([0.0, 0.15]),
)
@example([0.5 + 0.99 * (0.5 + CONFIG.limit_tolerance)] * 4, [0.0] * 4, 0.0)
@example([0.5 - 0.99 * (0.5 + CONFIG.limit_tolerance)] * 4, [0.0] * 4, 0.0)
def test_a_reading_beyond_its_limit_is_no_end_stop(
    shares: list[float], velocity: list[float], prediction_s: float
) -> None:
    config = dataclasses.replace(CONFIG, limit_prediction_s=prediction_s)
    q, speed = LOWER + np.array(shares) * RANGE, np.array(velocity)
    margin = config.limit_tolerance * RANGE
    both = np.stack([q, q + prediction_s * speed])
    fine = bool((both >= LOWER - margin).all() and (both <= UPPER + margin).all())
    assert (JointLimits(bobcat(), config).on_state(state(1.0, q, speed), 0) is None) == fine


@given(
    st.lists(
        st.tuples(st.sampled_from([-1, 0, 1]), st.booleans(), st.integers(1, 80)), min_size=1, max_size=8
    ),
    st.integers(0, 3),
    st.booleans(),
)
def test_a_joint_is_pressed_into_its_stop_for_so_long_and_no_longer(
    stretches, joint: int, upper: bool
) -> None:
    """Stretches of one command at one place, of so many ticks: the objection is that of a counter of ticks."""
    period_s = 0.05
    rule = JointLimits(bobcat(), dataclasses.replace(CONFIG, maximum_stop_s=1.0))
    stop = MIDDLE.copy()
    stop[joint] = (UPPER if upper else LOWER)[joint]
    n, pressed, before = 0, -1, (0, False)
    for direction, at_stop, ticks in stretches:
        for _ in range(ticks):
            now_ns = nanoseconds(n * period_s)
            values = np.zeros(4)
            values[joint] = direction
            rule.on_command(command(values=values), now_ns)
            assert rule.on_state(state(n * period_s, stop if at_stop else MIDDLE), now_ns) is None
            goes_on = direction != 0 and at_stop and before == (direction, at_stop)
            pressed, before = pressed + 1 if goes_on else 0, (direction, at_stop)
            assert (rule.on_tick(now_ns) is not None) == (pressed > 20)
            n += 1


@pytest.mark.parametrize("stop", [LOWER, UPPER], ids=["lower", "upper"])
def test_an_arm_that_rests_at_its_end_stop_is_not_pressed(stop: np.ndarray) -> None:
    rule = JointLimits(bobcat(), CONFIG)
    assert rule.on_state(state(0.0, stop), 0) is None
    assert rule.on_tick(nanoseconds(2 * CONFIG.maximum_stop_s)) is None


def test_a_joint_that_runs_into_its_stop_and_away_again_is_ordinary_work() -> None:
    """At the fastest joint's speed: two and a half seconds of way, as long at the stop, and back."""
    rule, q, period_s = JointLimits(bobcat(), CONFIG), MIDDLE.copy(), 0.05
    for n in range(2000):
        direction = 1 if n % 200 < 100 else -1
        before = q[0]
        q[0] = np.clip(before + 0.4 * RANGE[0] * direction * period_s, LOWER[0], UPPER[0])
        velocity = [(q[0] - before) / period_s, 0, 0, 0]
        now_ns = nanoseconds(n * period_s)
        rule.on_command(command(values=(direction, 0, 0, 0)), now_ns)
        assert rule.on_state(state(n * period_s, q, velocity), now_ns) is None
        assert rule.on_tick(now_ns) is None


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4), st.floats(0.02, 0.2))
def test_a_clearance_is_cut_off_at_its_horizon(shares: list[float], horizon_m: float) -> None:
    q = LOWER + np.array(shares) * RANGE
    shapes = SelfCollision(bobcat(), MACHINE_DIRECTORY)
    assert shapes.clearance(q, horizon_m) == pytest.approx(min(shapes.clearance(q, 1.0), horizon_m), abs=1e-6)


def test_shapes_go_by_their_joints_names_not_by_their_order() -> None:
    machine, folded = bobcat(), np.array([0.0, 0.3, -2.2, -2.2])
    turned = SelfCollision(dataclasses.replace(machine, joints=machine.joints[::-1]), MACHINE_DIRECTORY)
    shapes = SelfCollision(machine, MACHINE_DIRECTORY)
    assert turned.clearance(folded[::-1], 1.0) == pytest.approx(shapes.clearance(folded, 1.0))


def test_two_balls_on_an_elbow_are_as_far_apart_as_geometry_says(tmp_path: Path) -> None:
    """The forearm's ball against the base's, each a metre from the elbow; links that are joined do not count."""
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    radii, texts, last = {"base_link": 0.1, "swing": 0.3, "boom": 0.2}, [], "base_link"
    for number, name in enumerate(["base_link", *bobcat().joint_names]):
        at = 1.0 if name == "boom" else 0.0
        shape = f'<origin xyz="{at} 0 0"/><geometry><sphere radius="{radii.get(name)}"/></geometry>'
        texts.append(
            f'<link name="{name}">{mass}{f"<visual>{shape}</visual>" if name in radii else ""}</link>'
        )
        if number:
            texts.append(
                f'<joint name="{name}" type="continuous"><parent link="{last}"/><child link="{name}"/>'
                f'<origin xyz="{at} 0 0"/><axis xyz="0 0 1"/></joint>'
            )
        last = name
    robot = (
        '<robot name="elbow"><mujoco><compiler discardvisual="false"/></mujoco>' + "".join(texts) + "</robot>"
    )
    arm = bobcat().arm
    assert arm is not None
    (tmp_path / arm.urdf).write_text(robot)
    shapes = SelfCollision(bobcat(), tmp_path)
    for swing, elbow in ((0.0, 0.0), (1.0, 2.0), (-1.0, -2.5)):
        distance_m = shapes.clearance(np.array([swing, elbow, 0.5, 0.5]), 10.0)
        assert distance_m == pytest.approx(2.0 * np.cos(elbow / 2.0) - 0.3, abs=1e-5)


def test_a_hammer_folded_into_the_boom_is_a_collision() -> None:
    rules = build_rules(parts("self_collision"))
    rule = rules["self_collision"]
    rule.on_state(state(1.0, MIDDLE), 0)
    assert rule.on_tick(0) is None
    rule.on_state(
        state(1.0, [0.0, 0.3, -2.4, -2.2]), 0
    )  # the hammer's tip in the boom: all joints within limits
    assert rule.on_tick(0) is not None


def test_the_supervisor_stops_once_and_goes_on_saying_so() -> None:
    supervisor = supervise(bobcat(), supervised(), MACHINE_DIRECTORY)
    outputs = [
        *supervisor.on_message(Topic.requested_commands, command(values=(2, 0, 0, 0)), 0),
        *supervisor.on_message(Topic.requested_commands, command(values=(2, 0, 0, 0)), 0),
        *supervisor.on_timer(1),
    ]
    stops = [output.message for output in outputs if isinstance(output.message, EmergencyStop)]
    assert [stop.rule for stop in stops] == ["command_value"]
    assert outputs[-1].message.rule == "command_value"


def test_an_older_stop_of_another_component_changes_nothing() -> None:
    supervisor = supervise(bobcat(), paper(), MACHINE_DIRECTORY)
    for stamp_ns in (5, 3):
        assert supervisor.on_message(Topic.emergency_stop, EmergencyStop(stamp_ns, "a", ""), 10) == ()
    assert supervisor.stop is not None and supervisor.stop.stamp_ns == 5


def test_a_joystick_with_too_few_axes_is_not_neutral() -> None:
    supervisor = supervise(bobcat(), paper(), MACHINE_DIRECTORY)
    supervisor.on_message(Topic.emergency_stop, EmergencyStop(5, "a", ""), 10)
    supervisor.on_message(Topic.joystick, Joystick(20, np.zeros(2)), 20)
    supervisor.on_message(Topic.reset, Reset(30, 5), 30)
    supervisor.on_timer(nanoseconds(2 * paper().supervisor.neutral_s))
    assert supervisor.stop is not None


def test_shapes_that_are_all_near_are_all_measured() -> None:
    shapes = SelfCollision(bobcat(), MACHINE_DIRECTORY)
    assert 0.0 < shapes.clearance(MIDDLE, 100.0) == pytest.approx(shapes.clearance(MIDDLE, 10.0))


def test_an_unknown_rule_is_refused() -> None:
    with pytest.raises(InputError, match="no rule `gravity`"):
        build_rules(parts("gravity"))


def test_a_jump_names_the_joint_that_jumped_most() -> None:
    rule = EncoderReading(bobcat(), CONFIG)
    rule.on_state(state(1.0), 0)
    text = rule.on_state(state(1.02, MIDDLE + np.array([0.0, 0.3, 0.5, 0.0])), 0)
    assert text == f"encoder of {bobcat().joint_names[2]} jumped by 0.5000 rad"


def test_shapes_are_predicted_ahead_not_back() -> None:
    rule = build_rules(parts("self_collision"))["self_collision"]
    folded = np.array([0.0, 0.3, -2.4, -2.2])
    for sign, objects in ((1.0, True), (-1.0, False)):
        rule.on_state(state(1.0, MIDDLE, sign * (folded - MIDDLE) / CONFIG.prediction_s), 0)
        assert (rule.on_tick(0) is not None) == objects
    rule.on_state(state(2.0, folded), 0)
    assert rule.on_tick(0) == "links come within 0.000 m of each other"
    rule.on_state(state(3.0, folded, np.full(4, np.nan)), 0)
    assert rule.on_tick(0) is None  # another rule's affair


def test_sticks_at_their_threshold_are_neutral_on_the_axes_that_count() -> None:
    config = supervised()
    n_axes = max(config.teleoperation.axes[: bobcat().n_joint]) + 1
    threshold = config.teleoperation.threshold
    for n, deflection, is_released in ((0, threshold, True), (0, 0.999, False), (1, 0.0, False)):
        supervisor = supervise(bobcat(), config, MACHINE_DIRECTORY)
        supervisor.on_message(Topic.emergency_stop, EmergencyStop(5, "a", ""), 10)
        sticks = Joystick(20, np.full(n_axes - n, deflection))
        supervisor.on_message(Topic.joystick, sticks, 20)
        supervisor.on_message(Topic.reset, Reset(30, 5), 30)
        supervisor.on_timer(nanoseconds(2 * config.supervisor.neutral_s))
        assert (supervisor.stop is None) == is_released


def test_the_neutral_time_begins_when_the_stick_is_let_go_between_two_ticks() -> None:
    supervisor, neutral_ns = (
        supervise(bobcat(), supervised(), MACHINE_DIRECTORY),
        nanoseconds(CONFIG.neutral_s),
    )
    supervisor.on_message(Topic.emergency_stop, EmergencyStop(5, "a", ""), 10)
    supervisor.on_message(Topic.joystick, Joystick(20, np.ones(8)), 20)
    supervisor.on_message(Topic.reset, Reset(30, 5), 30)
    supervisor.on_timer(40)
    supervisor.on_message(Topic.joystick, Joystick(60, np.zeros(8)), 60)
    for now_ns, is_stopped in ((59 + neutral_ns, True), (60 + neutral_ns, False)):
        supervisor.on_timer(now_ns)
        assert (supervisor.stop is not None) == is_stopped


def test_only_a_released_stop_is_released_again() -> None:
    supervisor = supervise(bobcat(), supervised(), MACHINE_DIRECTORY)
    assert supervisor.on_message(Topic.reset, Reset(7, 6), 7) == ()
    supervisor.on_message(Topic.emergency_stop, EmergencyStop(5, "a", ""), 10)
    supervisor.on_message(Topic.reset, Reset(30, 5), 30)
    supervisor.on_timer(end_ns := nanoseconds(2 * CONFIG.neutral_s))
    (again,) = supervisor.on_message(Topic.reset, Reset(end_ns, 5), end_ns + 1)
    assert again == Publication(Topic.release, Release(end_ns + 1, 5))
    assert supervisor.on_message(Topic.reset, Reset(end_ns, 6), end_ns + 2) == ()


def test_what_is_no_command_changes_nothing_for_the_joints() -> None:
    stop, after_s = np.where(np.arange(4) == 0, UPPER, MIDDLE), CONFIG.maximum_stop_s + 0.1
    limits, frozen = JointLimits(bobcat(), CONFIG), FrozenEncoder(bobcat(), CONFIG)
    for rule, q, name in ((limits, stop, "limits"), (frozen, MIDDLE, "frozen")):
        rule.on_state(state(0.0, q), 0)
        rule.on_command(command(values=(1, 0, 0, 0)), 0)
        rule.on_command(command(values=(2, 0, 0, 0)), nanoseconds(1.0))
        rule.on_state(state(after_s, q), nanoseconds(after_s))
        assert rule.on_tick(nanoseconds(after_s)) is not None, name


def test_a_reading_after_one_that_is_no_number_has_not_jumped() -> None:
    rule = EncoderReading(bobcat(), CONFIG)
    assert rule.on_state(state(1.0, np.full(4, np.nan)), 0) is not None
    assert rule.on_state(state(1.02, MIDDLE + 0.5), 0) is None


def test_messages_to_others_are_none_of_the_supervisor_s() -> None:
    supervisor = supervise(bobcat(), supervised(), MACHINE_DIRECTORY)
    assert supervisor.on_message(Topic.release, Release(7, 6), 7) == ()


def test_objections_tell_times_in_seconds() -> None:
    config, zero = supervised().supervisor, np.zeros(4)
    at_ns = [nanoseconds(second) for second in (2.0, 2.2, 1.9)]
    commands, states = CommandFrequency(config), StateFrequency(config)
    assert commands.on_command(JointCommand(at_ns[0], "server", 1, 0, zero), at_ns[0]) is None
    assert commands.on_tick(at_ns[1]) == "no command of server for 0.200 s"
    commands.on_command(JointCommand(at_ns[1], "server", 2, 0, zero, is_last=True), at_ns[1])
    assert commands.on_tick(2 * at_ns[1]) is None  # after its last command a server may be silent
    assert states.on_state(JointState(at_ns[0], zero, zero), at_ns[0]) is None
    assert states.on_tick(at_ns[1]) == "no joint state for 0.200 s"
    for before_s in (0.1, 0.0):
        said = states.on_state(JointState(at_ns[2], zero, zero), at_ns[1])
        assert said == f"joint state of {before_s:.3f} s before the last one"
    encoder = EncoderReading(bobcat(), config)
    assert (
        encoder.on_state(JointState(0, np.full(4, np.nan), zero), 0) == "an encoder's reading is not finite"
    )
    frozen = FrozenEncoder(bobcat(), config)
    frozen.on_command(JointCommand(0, "server", 1, 0, np.array([0.0, 1.0, 0.0, 0.0])), at_ns[0])
    for now_ns in (at_ns[0], 2 * at_ns[0]):
        frozen.on_state(JointState(0, MIDDLE, zero), now_ns)
    joint = bobcat().joint_names[1]
    assert frozen.on_tick(2 * at_ns[0]) == f"encoder of {joint} has not changed for 2.00 s of commands"
    limits, q = JointLimits(bobcat(), config), np.where(np.arange(4) == 1, UPPER, MIDDLE)
    limits.on_command(command(values=(0, 1, 0, 0)), 0)
    limits.on_state(state(0.0, q), 0)
    assert limits.on_tick(nanoseconds(6.0)) == f"{joint} has been commanded into its end stop for 6.00 s"
    q[1] = UPPER[1] + 1.0
    assert limits.on_state(state(6.0, q), 0) == f"{joint} at {q[1]:.3f} rad leaves its limits"
