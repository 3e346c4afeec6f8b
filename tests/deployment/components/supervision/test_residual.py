"""The rule of the residual: evidence against its definition, a model whose motion is written down as the machine."""

import dataclasses
import json
from pathlib import Path

import jax
import numpy as np
import pytest

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.deployment.component import nanoseconds
from pipeline.deployment.components.supervision.control_supervisor import supervise
from pipeline.deployment.components.supervision.free_running_model import FreeRunningModel, moved_to
from pipeline.deployment.components.supervision.model_floor import (
    ModelFloor,
    chance,
    measure_floor,
    read_floor,
)
from pipeline.deployment.components.supervision.motion_window import MotionSteps, evidence
from pipeline.deployment.components.supervision.residual_rule import FollowsModel
from pipeline.deployment.components.supervision.supervisor_rules import RuleParts, build_rules
from pipeline.deployment.messages import EmergencyStop, JointCommand, JointState, SupervisorState, Topic
from pipeline.dynamics.model.dynamics_model import DynamicsModel, Target
from pipeline.dynamics.model.shown_motion import NEAR_SHARE, STANDING_SHARE
from pipeline.dynamics.model.store import model_fingerprint, save_model
from pipeline.effects.augmented_model import AugmentedHistory
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from tests.deployment.machines import MIDDLE, bobcat, specification, supervised
from tests.reaching.lag import FULL_SPEED, lag_dynamics

MACHINE, DT_S = bobcat(), bobcat().dt_s
NAMES = MACHINE.joint_names
HALF, HOURS = 0.5, 1.0
FOLLOWER = FreeRunningModel(lag_dynamics(MACHINE), {}, MACHINE)
PERIOD_STEPS = 30  # of a command up and down


def driven(
    seed: int,
    n_steps: int,
    slow: tuple[int, float, int] | None = None,
    wander: float = 0.05,
    spell_steps: int = 1,
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and commands of a machine like the model, whose speed wanders; (T, 4) each.

    Args:
        seed: of its noise.
        n_steps: T.
        slow: joint, share of its speed, and step from which it holds.
        wander: of the speed, as a share of it.
        spell_steps: for which it stays as it is.
    """
    random, share = np.random.default_rng(seed), np.ones(4)
    phase = random.integers(PERIOD_STEPS, size=4)
    a = np.where((np.arange(n_steps)[:, None] + phase) % PERIOD_STEPS < PERIOD_STEPS // 2, 1.0, -1.0)
    history, q, positions = FOLLOWER.begin(MIDDLE), MIDDLE.copy(), []
    for step in range(n_steps):
        positions.append(q + 1e-4 * random.standard_normal(4))
        if slow is not None and step == slow[2]:
            share[slow[0]] = slow[1]
        history, moved = FOLLOWER.step(history, q, a[step])
        if step % spell_steps == 0:
            wandering = 1.0 + wander * random.standard_normal(4)
        q = q + moved * share * wandering
    return np.array(positions), a


def trajectory(q: np.ndarray, a: np.ndarray, is_validation: bool = True) -> Trajectory:
    rows = np.full(len(q), is_validation)
    t_s = DT_S * np.arange(len(q))
    return Trajectory("drive", t_s, (1e9 * t_s).astype(np.int64), q, 0 * q, a, rows)


@pytest.fixture(scope="module")
def floor() -> ModelFloor:
    return measure_floor(FOLLOWER, "lag", [trajectory(*driven(0, 2400))], [], HALF, HOURS)


def heard(rule: FollowsModel, q: np.ndarray, a: np.ndarray, late_s: float = 0.001) -> list[tuple[int, str]]:
    """What the rule says of rows that arrive one by one, with the rows' numbers."""
    said = []
    for step in range(len(q)):
        now_ns = nanoseconds(step * DT_S)
        rule.on_command(JointCommand(now_ns, "server", step, now_ns, a[step]), now_ns)
        text = rule.on_state(JointState(now_ns, q[step], 0 * q[step]), now_ns + nanoseconds(late_s))
        if text is not None:
            said.append((step, text))
    return said


def defined(expected: np.ndarray, measured: np.ndarray, at: np.ndarray) -> float:
    """D of one joint's steps `at`, as the module's text has it; displacements (T,)."""

    def least(of_measured: float, of_expected: float) -> float:
        sums = []
        for shift in range(-3, 10):
            shifted = [expected[t - shift] if t >= shift else 0.0 for t in at]
            sums.append(np.sum((of_measured * measured[at] - of_expected * np.array(shifted)) ** 2))
        return min(sums)

    motion = np.sum(np.maximum(np.abs(measured[at]), np.abs(expected[at])) ** 2)
    return (least(1.0, 1.0) - min(least(1.0, HALF), least(HALF, 1.0))) / motion


@pytest.mark.parametrize("share", [1.0, 0.5, 2.0])
def test_evidence_is_as_defined(share: float) -> None:
    random, steps = np.random.default_rng(0), MotionSteps(specification(), HALF)
    expected = random.standard_normal((60, 4))
    measured = share * expected + 0.1 * random.standard_normal((60, 4))
    around = steps.around(expected)
    terms = steps.terms(around, measured[: len(around)])
    at = np.array([0, 1, 5, 20, 21, 22, 56])
    for joint in range(4):
        found = evidence(terms[at, joint].sum(axis=0))
        assert found == pytest.approx(defined(expected[:, joint], measured[:, joint], at))


def test_steps_count_in_motion_and_away_from_the_end_that_a_joint_is_pushed_into() -> None:
    moving = MotionSteps(dataclasses.replace(specification(), velocity_limit=[0.5, 1.0, 2.0, 4.0]), HALF)
    speed, none = np.array([0.5, 1.0, 2.0, 4.0]), np.zeros(4)

    def count(q: np.ndarray, expected: np.ndarray, measured: np.ndarray) -> np.ndarray:
        rows = np.zeros((4, 4))
        rows[0] = expected
        return moving.count(q, moving.around(rows)[0], measured)

    for share, counts in ((0.99, False), (1.01, True)):
        step = share * STANDING_SHARE * DT_S * speed
        for moved in ((step, none), (-step, none), (none, step), (none, -step)):
            assert (count(MIDDLE, *moved) == counts).all()
    for end, sign in ((MACHINE.lower, -1.0), (MACHINE.upper, 1.0)):
        for margins, pushed, counts in ((0.9, 1, False), (0.9, -1, True), (1.1, 1, True), (0.9, 0, True)):
            q = end - sign * margins * NEAR_SHARE * (MACHINE.upper - MACHINE.lower)
            assert (count(q, pushed * sign * DT_S * speed, DT_S * speed) == counts).all()


def test_the_chance_of_a_false_stop_is_bounded_beyond_what_was_seen() -> None:
    """Exponential evidence is at its limit once in 10,000 runs; evidence that ends below it, never."""
    random, level = np.random.default_rng(0), np.log(1e4)
    bounds = np.array([chance(random.exponential(size=500) - level) for _ in range(40)])
    assert np.mean(bounds >= 1e-4) >= 0.8
    assert np.median(bounds) < 3.0 / 500  # what is known of 500 runs without an extrapolation
    assert chance(random.random(500) - 2.0) < 1e-6
    assert chance(np.linspace(-1.0, 1.0, 500)) == 0.5  # more than the tail: as often as was seen
    assert chance(np.full(500, -1.0)) == 3.0 / 500


def test_the_rule_finds_the_evidence_row_by_row(floor: ModelFloor) -> None:
    q, a = driven(1, 300)
    rule = FollowsModel(MACHINE, FOLLOWER, floor, HOURS)
    assert heard(rule, q, a) == []
    expected, measured = FOLLOWER.displacements(q, a), np.diff(q, axis=0)
    moves = np.maximum(np.abs(expected), np.abs(measured)) > STANDING_SHARE * DT_S
    moves[: FOLLOWER.settling_steps] = False
    for joint in range(4):
        at = np.flatnonzero(moves[:-3, joint])[-floor.window_steps :]
        assert rule.evidence[joint] == pytest.approx(
            defined(expected[:, joint], measured[:, joint], at), abs=1e-3
        )


@pytest.mark.parametrize("late_steps", [-3, 5, 9])
def test_a_machine_that_is_early_or_late_is_not_told(late_steps: int, floor: ModelFloor) -> None:
    q, a = driven(2, 300)
    said = np.roll(a, -late_steps, axis=0)  # so much before, or after, the machine acts on it
    assert heard(FollowsModel(MACHINE, FOLLOWER, floor, HOURS), q, said) == []
    assert heard(
        FollowsModel(MACHINE, FOLLOWER, floor, HOURS), q, np.roll(a, -15, axis=0)
    )  # the other way round


def test_a_late_start_is_not_told(floor: ModelFloor) -> None:
    """A spool that rested swallows the first 0.3 s, and the joint stops in time."""
    a = np.zeros((300, 4))
    a[60:90, 0], a[90:120, 0] = 1.0, -1.0
    expected = FOLLOWER.displacements(np.tile(MIDDLE, (300, 1)), a)
    first = np.flatnonzero(expected[:, 0])[0]
    expected[first : first + 6] = 0.0
    q = MIDDLE + np.concatenate([np.zeros((1, 4)), np.cumsum(expected, axis=0)])
    assert heard(FollowsModel(MACHINE, FOLLOWER, floor, HOURS), q, a) == []


@pytest.mark.parametrize("joint", range(4))
@pytest.mark.parametrize("share", [0.5, 0.0, -1.0])
def test_a_joint_that_no_longer_follows_is_told_within_its_window(
    joint: int, share: float, floor: ModelFloor
) -> None:
    onset = 100
    rule = FollowsModel(MACHINE, FOLLOWER, floor, HOURS)
    said = heard(rule, *driven(2, 200, (joint, share, onset)))
    assert said and all(text.startswith(f"{NAMES[joint]} no longer follows its model") for _, text in said)
    assert onset < said[0][0] <= onset + 2 * floor.window_steps  # half the time it reverses


@pytest.mark.parametrize("share", [0.85, 1.15])
def test_a_joint_near_its_speed_still_follows(share: float, floor: ModelFloor) -> None:
    assert heard(FollowsModel(MACHINE, FOLLOWER, floor, HOURS), *driven(3, 400, (0, share, 0))) == []


def test_a_joint_that_moves_without_a_command_is_told(floor: ModelFloor) -> None:
    q = np.tile(MIDDLE, (120, 1))
    q[60:, 2] -= FULL_SPEED * DT_S * np.arange(60)
    said = heard(FollowsModel(MACHINE, FOLLOWER, floor, HOURS), q, np.zeros_like(q))
    assert said and said[0][1].startswith("arm")


def test_a_joint_at_its_end_stop_is_not_told(floor: ModelFloor) -> None:
    q = np.tile(MACHINE.upper, (200, 1)) - 1e-3
    assert heard(FollowsModel(MACHINE, FOLLOWER, floor, HOURS), q, np.ones_like(q)) == []


def test_gaps_and_readings_that_are_no_numbers_begin_anew(floor: ModelFloor) -> None:
    """A machine in motion is not judged before the model's window is that of the motion."""
    q, a = driven(4, 200)
    q[60] = np.nan
    assert heard(FollowsModel(MACHINE, FOLLOWER, floor, HOURS), q, a) == []
    rule = FollowsModel(MACHINE, FOLLOWER, floor, HOURS)
    invalid = JointCommand(0, "server", 0, 0, np.full(4, 2.0))
    assert rule.on_command(invalid, 0) is None
    for stamp_s in (0.0, 5.0, 4.0, 4.0):
        assert (
            rule.on_state(JointState(nanoseconds(stamp_s), MIDDLE, 0 * MIDDLE), nanoseconds(stamp_s)) is None
        )


def test_readings_between_the_rows_are_interpolated(floor: ModelFloor) -> None:
    """Readings five times as often, off the grid, say the same of a motion at constant speed."""
    steps = np.arange(0, 100, 0.2)
    a = np.tile([1.0, 0, 0, 0], (100, 1))
    q = np.concatenate(
        [MIDDLE[None], MIDDLE + np.cumsum(FOLLOWER.displacements(np.tile(MIDDLE, (100, 1)), a), axis=0)]
    )
    fine = np.stack([np.interp(steps, np.arange(100), column) for column in q.T], axis=1)
    coarse, dense = (FollowsModel(MACHINE, FOLLOWER, floor, HOURS) for _ in range(2))
    heard(coarse, q, a)
    for number, step in enumerate(steps):
        now_ns = nanoseconds(step * DT_S)
        if number % 5 == 0:
            dense.on_command(JointCommand(now_ns, "server", number, now_ns, a[0]), now_ns)
        dense.on_state(JointState(now_ns, fine[number], 0 * MIDDLE), now_ns)
    np.testing.assert_allclose(dense.evidence, coarse.evidence, atol=1e-6)


def test_only_rows_that_no_fit_saw_make_the_floor(floor: ModelFloor) -> None:
    seen = trajectory(*driven(8, 2400, None, 0.3, 20), is_validation=False)
    unseen = dataclasses.replace(trajectory(*driven(0, 2400)), name="other#1")
    found = measure_floor(FOLLOWER, "lag", [seen, unseen], ["drive"], HALF, HOURS)
    np.testing.assert_array_equal(found.limit, floor.limit)
    with pytest.raises(InputError, match="too little motion that no fit saw: 100 windows of 2 s"):
        measure_floor(FOLLOWER, "lag", [seen], ["drive"], HALF, HOURS)


def test_a_longer_window_is_taken_where_a_shorter_leaves_too_few_hours() -> None:
    """A machine whose speed wanders for a second at a time looks slow for two of them, not for eight."""
    logs = [trajectory(*driven(8, 2400, None, 0.3, 20))]
    few, most = (measure_floor(FOLLOWER, "lag", logs, [], HALF, hours) for hours in (1e-5, 1e9))
    assert few.window_steps * DT_S == 2.0 < most.window_steps * DT_S
    assert few.hours == 1e-5 < most.hours < 1.0
    with pytest.raises(InputError, match="share below 1"):
        measure_floor(FOLLOWER, "lag", logs, [], 1.0, HOURS)


def test_the_limit_is_what_slowed_motion_reaches(floor: ModelFloor) -> None:
    """At exactly half its speed a joint's evidence is what the whole speed misses: a quarter, less by shifts."""
    assert (floor.limit > 0.1).all() and (floor.limit < 0.25).all()
    stands = measure_floor(FOLLOWER, "lag", [trajectory(*driven(0, 2400))], [], 0.0, HOURS)
    assert (stands.limit > floor.limit).all()


def test_a_floor_is_read_as_it_was_written(floor: ModelFloor, tmp_path: Path) -> None:
    path = tmp_path / "floor.json"
    floor.write(path)
    again = read_floor(path, "lag")
    np.testing.assert_array_equal(again.limit, floor.limit)
    assert dataclasses.replace(again, limit=floor.limit) == floor
    with pytest.raises(InputError, match="is the floor of another model; run measure_floor with this model"):
        read_floor(path, "other")
    with pytest.raises(InputError, match="No such file"):
        read_floor(tmp_path / "none.json", "lag")
    for content, said in (('{"model": "lag"}', "not a model's floor"), ("[]", "not a model's floor")):
        path.write_text(content)
        with pytest.raises(InputError, match=said):
            read_floor(path, "lag")
    path.write_text(json.dumps({"schema_version": 2, "model": "lag", "scores": []}))
    with pytest.raises(InputError, match="of version 2, not 3; measure it again: run measure_floor"):
        read_floor(path, "lag")


def test_a_floor_that_tells_too_little_is_refused(floor: ModelFloor) -> None:
    with pytest.raises(InputError, match="false_stop_hours is 1e\\+12: this floor carries 1; ask for fewer"):
        FollowsModel(MACHINE, FOLLOWER, floor, 1e12)


@pytest.mark.parametrize("only_warns", [False, True])
def test_the_supervisor_stops_or_warns(only_warns: bool, floor: ModelFloor, monkeypatch) -> None:
    monkeypatch.setattr(RuleParts, "followed", (FOLLOWER, floor))
    config = supervised()
    rules = dataclasses.replace(
        config.supervisor,
        rules=["model_residual"],
        warnings=["model_residual"] if only_warns else [],
        floor="floor.json",
        false_stop_hours=HOURS,
    )
    config = dataclasses.replace(config, supervisor=rules)
    supervisor = supervise(MACHINE, config, MACHINE_DIRECTORY, "model")
    q, a = driven(7, 200, (1, 0.0, 60))
    stops = []
    for step in range(len(q)):
        now_ns = nanoseconds(step * DT_S)
        supervisor.on_message(
            Topic.requested_commands, JointCommand(now_ns, "server", step, now_ns, a[step]), now_ns
        )
        state = JointState(now_ns, q[step], 0 * MIDDLE)
        stops += [o.message for o in supervisor.on_message(Topic.joint_states, state, now_ns)]
    assert [stop.rule for stop in stops if isinstance(stop, EmergencyStop)] == ["model_residual"] * (
        not only_warns
    )
    assert supervisor.warned.keys() == ({"model_residual"} if only_warns else set())
    assert isinstance(supervisor.on_timer(0)[-1].message, SupervisorState)


def test_without_a_floor_the_rule_is_told_to_be_off() -> None:
    told = supervise(MACHINE, supervised(), MACHINE_DIRECTORY, "model").condition(0).values
    assert told["rule model_residual"] == "off: no model, or no floor of it"
    assert {state for name, state in told.items() if name.startswith("rule ")} == {
        "no objection",
        told["rule model_residual"],
    }


def test_a_warning_of_a_rule_that_is_off_is_refused() -> None:
    with pytest.raises(InputError, match="warnings: joint_limits not among its rules"):
        dataclasses.replace(supervised().supervisor, rules=[], warnings=["joint_limits"])


@pytest.mark.parametrize("target", list(Target))
def test_motion_elsewhere_is_the_same_motion(target: Target) -> None:
    history = FOLLOWER.begin(MIDDLE)
    moved = moved_to(history, MIDDLE + 0.1, target)
    np.testing.assert_allclose(moved.q, MIDDLE + 0.1, atol=1e-6)
    np.testing.assert_allclose(
        moved.motion, history.motion + (0.1 if target is Target.dq else 0.0), atol=1e-6
    )


def test_motion_elsewhere_moves_the_machine_within_effects_too() -> None:
    history = FOLLOWER.begin(MIDDLE)
    nominal = history._replace(q=history.q + 0.3)  # as with a sensor's bias
    moved = moved_to(AugmentedHistory(*history, nominal, {}, 0.0), MIDDLE + 0.1, Target.dqdot)
    np.testing.assert_allclose(moved.q, MIDDLE + 0.1, atol=1e-6)
    np.testing.assert_allclose(moved.nominal.q, MIDDLE + 0.4, atol=1e-6)


def test_the_rule_is_built_of_a_model_s_folder_and_its_floor(tmp_path: Path) -> None:
    model = DynamicsModel(specification())
    save_model(tmp_path / "model", model, model.initialise(jax.random.key(0)), {}, {}, {})
    one = np.ones(4)
    floor = ModelFloor(model_fingerprint(tmp_path / "model"), HALF, 40, 100.0, 0.2 * one)
    floor.write(tmp_path / "floor.json")
    config = dataclasses.replace(
        supervised().supervisor, rules=["model_residual"], floor=str(tmp_path / "floor.json")
    )
    rules = build_rules(RuleParts(MACHINE, config, MACHINE_DIRECTORY, tmp_path / "model"))
    assert isinstance(rules["model_residual"], FollowsModel)


def test_the_first_window_is_judged_once_its_steps_are_complete(floor: ModelFloor) -> None:
    """A joint in steady motion: the model settles, each row completes a step, and 3 more its shifts."""
    a = np.tile([1.0, 0, 0, 0], (100, 1))
    q = MIDDLE + np.cumsum(FOLLOWER.displacements(np.tile(MIDDLE, (len(a), 1)), a), axis=0)[: len(a)]
    rule, judged = FollowsModel(MACHINE, FOLLOWER, dataclasses.replace(floor, window_steps=20), HOURS), []
    for step in range(len(q)):
        now_ns = nanoseconds(step * DT_S)
        rule.on_command(JointCommand(now_ns, "server", step, now_ns, a[step]), now_ns)
        rule.on_state(JointState(now_ns, q[step], 0 * q[step]), now_ns)
        judged.append(bool(rule.evidence[0]))
    moves = FOLLOWER.displacements(q, a[: len(q)])[:, 0] > STANDING_SHARE * DT_S
    first = max(FOLLOWER.settling_steps, np.flatnonzero(moves)[0])
    assert judged.index(True) == first + 20 + 3
