"""The rule of the residual: e-values against their definition, a model whose motion is written down as the machine."""

import dataclasses
import json
from pathlib import Path

import jax
import numpy as np
import pytest
from scipy.stats import norm

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.deployment.component import nanoseconds
from pipeline.deployment.components.supervision.control_supervisor import supervise
from pipeline.deployment.components.supervision.free_running_model import FreeRunningModel, moved_to
from pipeline.deployment.components.supervision.model_floor import (
    BLOCK_STEPS,
    ModelFloor,
    MovingSteps,
    blocks_of,
    dependence,
    evidence,
    measure_floor,
    read_floor,
    score,
)
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
HALF = 0.5, 2.0  # speed, and motion until it is told, s
HOURS = 10.0
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
    return measure_floor(FOLLOWER, "lag", [trajectory(*driven(0, 2400))], [], *HALF)


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


def test_e_values_of_the_floor_s_own_blocks_are_one_on_average(floor: ModelFloor) -> None:
    """Of ranks 1 … n+1 alike, so is their mean by definition: at most one."""
    n = len(floor.scores)
    kappa = 1.0 / np.log(n + 1)
    e_values = kappa * (np.arange(1, n + 2) / (n + 1)) ** (kappa - 1.0)
    assert e_values.mean() <= 1.0
    motion = 0.1
    assert floor.log_e_value(0, motion, motion) == pytest.approx(np.log(e_values[0]))  # a joint that stands
    assert floor.log_e_value(0, 0.24 * motion, motion) == pytest.approx(
        np.log(e_values[-1])
    )  # one that follows


def test_a_score_is_the_likelihood_ratio_of_half_the_speed() -> None:
    expected, measured, scale = 0.2, np.linspace(0.0, 0.2, 9), 0.03
    residual = measured - expected
    ratio = norm.logpdf(residual, -expected / 2, scale) - norm.logpdf(residual, 0.0, scale)
    np.testing.assert_allclose(score(residual, np.full(9, expected), scale), ratio, atol=1e-9)


def test_ranks_are_those_among_the_floor_s_scores() -> None:
    one = np.ones(4)
    floor = ModelFloor("m", one, np.array([-3.0, 0.5, 0.7, 2.0]), one, one)
    kappa = 1.0 / np.log(5)
    residuals = np.array([0.4, 0.8, 1.2, 1.3, 9.0])  # scores of motion 2: -0.1, 0.3, 0.7, 0.8, 8.5
    p = np.array([5, 4, 3, 2, 1]) / 5
    np.testing.assert_allclose(
        floor.log_e_value(0, residuals, np.full(5, 2.0)), np.log(kappa * p ** (kappa - 1.0))
    )


def test_steps_count_in_motion_and_away_from_the_end_that_a_joint_is_pushed_into() -> None:
    moving = MovingSteps(dataclasses.replace(specification(), velocity_limit=[0.5, 1.0, 2.0, 4.0]))
    speed, none = np.array([0.5, 1.0, 2.0, 4.0]), np.zeros(4)
    for share, counts in ((0.99, False), (1.01, True)):
        step = share * STANDING_SHARE * DT_S * speed
        for moved in ((step, none), (-step, none), (none, step), (none, -step)):
            assert (moving.count(MIDDLE, *moved) == counts).all()
    for end, sign in ((MACHINE.lower, -1.0), (MACHINE.upper, 1.0)):
        for margins, pushed, counts in ((0.9, 1, False), (0.9, -1, True), (1.1, 1, True), (0.9, 0, True)):
            q = end - sign * margins * NEAR_SHARE * (MACHINE.upper - MACHINE.lower)
            assert (moving.count(q, pushed * sign * DT_S * speed, DT_S * speed) == counts).all()


def test_blocks_that_err_in_spells_stop_a_sound_machine_as_seldom_as_is_said() -> None:
    """Of spells of so many equal values, the product's exponent is exactly so many times smaller."""
    n, level, kappa, random = 200_000, 5.0, 0.2, np.random.default_rng(0)
    for spell in (1, 3):
        p = np.repeat(random.random(n // spell), spell)
        values = np.log(kappa) + (kappa - 1.0) * np.log(p)
        factor = dependence(values, 60)
        assert factor == pytest.approx(spell, rel=0.1)
        stops = np.count_nonzero(np.diff(evidence(values) >= level, prepend=False) > 0)
        assert np.exp(level / factor) <= n / stops
    assert n / stops < np.exp(level)
    assert dependence(np.full(100, -2.0), 10) == 1.0


def test_evidence_begins_anew_below_zero() -> None:
    np.testing.assert_allclose(evidence(np.array([2.0, -3.0, 1.0, 1.0])), [2.0, -1.0, 1.0, 2.0])


def test_the_rule_is_the_sum_over_blocks_row_by_row(floor: ModelFloor) -> None:
    q, a = driven(1, 300)
    rule = FollowsModel(MACHINE, FOLLOWER, floor, HOURS)
    assert heard(rule, q, a) == []
    expected, measured = FOLLOWER.displacements(q, a), np.diff(q, axis=0)
    counts = MovingSteps(FOLLOWER.specification).count(q[:-1], expected, measured)
    counts[: FOLLOWER.settling_steps] = False
    for joint in range(4):
        at = np.flatnonzero(counts[:, joint])
        blocks = blocks_of(expected[at, joint], measured[at, joint])
        assert len(blocks.residual) > 20
        assert rule.evidence[joint] == pytest.approx(
            evidence(floor.log_e_value(joint, *blocks))[-1], abs=1e-3
        )


@pytest.mark.parametrize("joint", range(4))
@pytest.mark.parametrize("share", [0.5, 0.0, -1.0])
def test_a_joint_that_no_longer_follows_is_told_within_two_seconds(
    joint: int, share: float, floor: ModelFloor
) -> None:
    onset = 100
    rule = FollowsModel(MACHINE, FOLLOWER, floor, HOURS)
    said = heard(rule, *driven(2, 200, (joint, share, onset)))
    assert said and said[0][1].startswith(f"{NAMES[joint]} no longer follows its model")
    standing_s = 0.4  # around each reversal, where nothing moves
    assert onset < said[0][0] <= onset + (2.0 + 3 * standing_s) / DT_S


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


def test_only_rows_that_no_fit_saw_make_the_floor() -> None:
    seen, unseen = trajectory(*driven(5, 900), is_validation=False), trajectory(*driven(6, 900))
    assert len(measure_floor(FOLLOWER, "lag", [seen, unseen], ["drive"], *HALF).scores) == len(
        measure_floor(FOLLOWER, "lag", [unseen], [], *HALF).scores
    )
    with pytest.raises(InputError, match="0 blocks of motion that no fit saw"):
        measure_floor(FOLLOWER, "lag", [seen], ["drive"], *HALF)


def test_the_floor_has_a_block_of_each_four_steps_that_count() -> None:
    """Of a seen recording's second piece, at the end of its range, the first rows are validation rows."""
    q, a = driven(6, 900)
    q += MACHINE.upper - q.max(axis=0)
    piece = dataclasses.replace(trajectory(q, a), name="drive#1", is_validation=np.arange(900) < 384)
    counts = MovingSteps(FOLLOWER.specification).count(
        q[:-1], FOLLOWER.displacements(q, a), np.diff(q, axis=0)
    )
    steps = counts[FOLLOWER.settling_steps : 384].sum(axis=0)
    found = measure_floor(FOLLOWER, "lag", [piece], ["drive"], *HALF)
    assert len(found.scores) == (steps // BLOCK_STEPS).sum() < (counts[:384].sum(axis=0) // BLOCK_STEPS).sum()


def test_a_floor_carries_fewer_hours_where_blocks_err_alike() -> None:
    once, long = (
        measure_floor(FOLLOWER, "lag", [trajectory(*driven(8, 2400, None, 0.5, spell))], [], *HALF)
        for spell in (BLOCK_STEPS, 10 * BLOCK_STEPS)
    )
    assert once.dependence.max() < 2.0 < 3.0 < long.dependence.min() < 9.0  # of runs of nine
    shortest = min(limit / factor for limit, factor in zip(long.limit, long.dependence, strict=True))
    assert long.n_blocks == pytest.approx(np.exp(shortest))


def test_a_joint_that_stands_or_more_time_leaves_longer_between_false_stops(floor: ModelFloor) -> None:
    def limit(speed: float, within_s: float) -> np.ndarray:
        return measure_floor(FOLLOWER, "lag", [trajectory(*driven(0, 2400))], [], speed, within_s).limit

    assert min(limit(0.0, 2.0).min(), limit(0.5, 4.0).min()) > floor.limit.min() > limit(0.5, 0.4).max()
    for speed, within_s, said in ((1.0, 2.0, "share below 1"), (0.5, 0.35, "0.4 s"), (0.5, 600.0, "needed")):
        with pytest.raises(InputError, match=said):
            limit(speed, within_s)


def test_a_floor_is_read_as_it_was_written(floor: ModelFloor, tmp_path: Path) -> None:
    path = tmp_path / "floor.json"
    floor.write(path)
    again = read_floor(path, "lag")
    np.testing.assert_array_equal(again.scale, floor.scale)
    np.testing.assert_array_equal(again.limit, floor.limit)
    np.testing.assert_array_equal(again.dependence, floor.dependence)
    np.testing.assert_allclose(again.scores, floor.scores, atol=1e-4)
    with pytest.raises(InputError, match="is the floor of another model; run measure_floor with this model"):
        read_floor(path, "other")
    with pytest.raises(InputError, match="No such file"):
        read_floor(tmp_path / "none.json", "lag")
    path.write_text(json.dumps({"model": "lag"}))
    with pytest.raises(InputError, match="not a model's floor"):
        read_floor(path, "lag")


def test_a_floor_that_tells_too_little_is_refused(floor: ModelFloor) -> None:
    with pytest.raises(InputError, match="false_stop_hours is 1000000000000"):
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


def test_blocks_are_sums_of_so_many_steps() -> None:
    measured = np.arange(2.0 * BLOCK_STEPS + 1)
    blocks = blocks_of(np.zeros_like(measured), measured)
    np.testing.assert_allclose(blocks.motion, [measured[:4].sum(), measured[4:8].sum()])
    np.testing.assert_allclose(blocks.residual, blocks.motion)


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
    floor = ModelFloor(model_fingerprint(tmp_path / "model"), one, one, 100 * one, one)
    floor.write(tmp_path / "floor.json")
    config = dataclasses.replace(
        supervised().supervisor, rules=["model_residual"], floor=str(tmp_path / "floor.json")
    )
    rules = build_rules(RuleParts(MACHINE, config, MACHINE_DIRECTORY, tmp_path / "model"))
    assert isinstance(rules["model_residual"], FollowsModel)


def test_the_first_block_is_judged_once_its_rows_are_counted(floor: ModelFloor) -> None:
    """A joint in steady motion: the model settles, then each row completes a step of the block."""
    steps = FOLLOWER.settling_steps + BLOCK_STEPS
    a = np.tile([1.0, 0, 0, 0], (steps + 4, 1))
    q = MIDDLE + np.cumsum(FOLLOWER.displacements(np.tile(MIDDLE, (len(a), 1)), a), axis=0)[: len(a)]
    rule, judged = FollowsModel(MACHINE, FOLLOWER, floor, HOURS), []
    for step in range(len(q)):
        now_ns = nanoseconds(step * DT_S)
        rule.on_command(JointCommand(now_ns, "server", step, now_ns, a[step]), now_ns)
        rule.on_state(JointState(now_ns, q[step], 0 * q[step]), now_ns)
        judged.append(bool(rule.evidence[0]))
    assert judged.index(True) == steps


def test_a_floor_must_be_told_from_as_many_blocks_as_the_hours_hold(floor: ModelFloor) -> None:
    blocks_per_hour = 3600.0 / (DT_S * BLOCK_STEPS) * 4
    floor = dataclasses.replace(floor, dependence=np.array([1.0, 1.0, 1.0, 2.0]))
    longest_h = np.exp(min(*floor.limit[:3], floor.limit[3] / 2.0)) / blocks_per_hour
    FollowsModel(MACHINE, FOLLOWER, floor, 0.99 * longest_h)
    with pytest.raises(InputError, match=f"carries {longest_h:.3g}; measure it on longer logs"):
        FollowsModel(MACHINE, FOLLOWER, floor, 1.01 * longest_h)
