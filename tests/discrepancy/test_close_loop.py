"""The whole loop on a machine simulated here: two first-order joints, nothing of the plant or of the model in it."""

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.discrepancy.acceptance.accept import accept
from pipeline.discrepancy.close_loop import close_loop
from pipeline.discrepancy.correction.correct import correct
from pipeline.discrepancy.correction.corrected_models import active_effects, held_out_errors
from pipeline.discrepancy.diagnosis.diagnose import diagnose
from pipeline.discrepancy.diagnosis.nominal_behaviour import NominalBehaviour, learn_nominal_behaviour
from pipeline.discrepancy.diagnosis.prepare import prepare
from pipeline.discrepancy.journal import Journal
from pipeline.discrepancy.selection.select import select
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, hypothesis_of
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.discrepancy.verdict.document import document_of
from pipeline.discrepancy.verdict.verdict import Verdict
from pipeline.dynamics.model.dynamics_model import DynamicsModel, Target
from pipeline.dynamics.model.network import Parameterization, Parameters
from pipeline.dynamics.settings import IdentifyConfig, TrainingConfig
from pipeline.dynamics.training.fit import fit
from pipeline.effects.dependence import OnChannel
from pipeline.effects.store import ActiveEffects, predictor
from pipeline.errors import InputError
from pipeline.logs.loop_tracker import LoopTrackerConfig, initial_state
from pipeline.logs.tracked_velocities import continue_tracking
from pipeline.logs.tuples import Trajectory
from pipeline.machine.log_sources import ChannelSource
from pipeline.machine.specification import JointSpecification, MachineSpecification

pytestmark = pytest.mark.slow

MACHINE = MachineSpecification(
    name="two_joints",
    rate_hz=20.0,
    joints=[JointSpecification("lift", -1.0, 1.0), JointSpecification("turn", -2.0, 2.0)],
    channels=[
        ChannelSource("rpm", column="rpm"),
        ChannelSource("oil", column="oil"),
    ],  # of which most logs lack both
)
SPEEDS = np.array([0.4, 0.6])
CONSTANTS_S = np.array([0.2, 0.3])
DT_S = 0.05


def record(
    name: str,
    seed: int,
    n_rows: int,
    slower: float = 1.0,
    late_rows: int = 0,
    sag: tuple[float, float, float] = (0.0, 0.0, 0.0),
    onset: int = 0,
    shared: float = 0.0,
    factor: np.ndarray | float = 1.0,
) -> Trajectory:
    """Random holds of commands.

    From row `onset` on the second joint is slower on its way down, by this factor, and all commands act later. The
    first joint creeps at velocities that are given for commands -1, 0 and 1. At full speed it takes this share
    of the second joint's. Speeds are multiplied by a factor, per row where it is (T, 2).
    """
    random = np.random.default_rng(seed)
    a, q = np.zeros((n_rows, 2)), np.zeros((n_rows, 2))
    factors = np.broadcast_to(factor, (n_rows, 2))
    velocity, command, left = np.zeros(2), np.zeros(2), np.zeros(2)
    for row in range(n_rows - 1):
        for joint in range(2):
            left[joint] -= 1
            if left[joint] <= 0:
                command[joint] = random.choice([-1.0, 0.0, 1.0])
                left[joint] = random.integers(4, 40)
            if abs(q[row, joint]) > 0.8 * (1.0, 2.0)[joint]:
                command[joint] = -np.sign(q[row, joint])
        a[row] = command
        acting = a[max(row - late_rows, 0)] if row >= onset else command
        target = factors[row] * SPEEDS * acting
        target[1] *= slower if acting[1] < 0 and row >= onset else 1.0
        velocity = velocity + (1.0 - np.exp(-DT_S / CONSTANTS_S)) * (target - velocity)
        q[row + 1] = q[row] + DT_S * velocity
        q[row + 1, 1] -= DT_S * shared * velocity[1] * abs(velocity[0]) / SPEEDS[0]
        q[row + 1, 0] += DT_S * sag[int(command[0]) + 1]
    q = q + 5e-4 * random.standard_normal(q.shape)
    tracker = LoopTrackerConfig(proportional_gain=10.0, integral_gain=60.0)
    _, qd = continue_tracking(initial_state(q[0]), q, DT_S, tracker)
    t_s = DT_S * np.arange(n_rows)
    stamp_ns = (1_000_000_000 * (1000 * seed + t_s)).astype(np.int64)
    return Trajectory(name, t_s, stamp_ns, q, qd, a, np.arange(n_rows) >= 0.9 * n_rows)


@pytest.fixture(scope="module")
def nominal() -> list[Trajectory]:
    """Two logs of the machine as it was."""
    return [record("nominal_1", 1, 5000), record("nominal_2", 2, 5000)]


@pytest.fixture(scope="module")
def model(nominal: list[Trajectory]) -> tuple[DynamicsModel, Parameters]:
    """A small model of it."""
    training = TrainingConfig([32], lags=10, horizon=16, learning_rate=5e-3, batch_size=256, maximum_epochs=4)
    identify = load_section("identify", IdentifyConfig, "default")
    result = fit(nominal, MACHINE, Parameterization.mlp, Target.dqdot, training, identify, seed=0)
    return result.model, result.parameters


def settings() -> tuple[CloseLoopConfig, IdentifyConfig]:
    """With a smaller budget of the diagnosis model."""
    identify = load_section("identify", IdentifyConfig, "paper")
    training = replace(identify.training_of("nfir_dqdot"), maximum_epochs=80)
    identify = replace(identify, selected={"nfir_dqdot": training})
    return load_section("close_loop", CloseLoopConfig, "paper"), identify


@pytest.fixture(scope="module")
def usual(nominal: list[Trajectory]) -> NominalBehaviour:
    """What the nominal logs say, learned once for all measured ones."""
    return learn_nominal_behaviour(nominal, MACHINE, *settings())


Model = tuple[DynamicsModel, Parameters]


def close(
    nominal: list[Trajectory], measured: list[Trajectory], model: Model, usual: NominalBehaviour
) -> dict[str, Any]:
    """The content of closed_loop.json."""
    return close_loop(nominal, measured, MACHINE, model, *settings(), nominal_behaviour=usual).document


@pytest.mark.long
def test_a_slower_direction_is_found_named_and_mended(nominal, model, usual) -> None:  # type: ignore[no-untyped-def]
    measured = [record("measured_1", 11, 4000, slower=0.7), record("measured_2", 12, 4000, slower=0.7)]
    journal = Journal()
    logs = prepare(nominal, measured, MACHINE, *settings())
    diagnosis = diagnose(logs, None, None, journal)  # which learns for itself what nominal logs say
    np.testing.assert_array_equal(diagnosis.nominal.floor, usual.floor)
    selection = select(diagnosis, journal)
    acceptance = accept(diagnosis, selection, journal)
    correction = correct(*model, diagnosis, selection, acceptance, journal)
    document = document_of(Verdict(diagnosis, selection, acceptance, correction))
    assert document["verdict"] == "named"
    (effect,) = document["effects"]
    assert (effect["family"], effect["joints"], effect["depends_on"]) == ("gain", ["turn"], ["command:turn"])
    ratio = effect["parameters"]["speed_ratio"]
    assert ratio["value"] == pytest.approx(0.7, abs=0.04)
    assert effect["parameters"]["direction"]["value"] == -1
    assert effect["error_reduction"] > 0.6
    assert set(document["baselines"]) == {"nominal_floor", "effects_on_nominal"}
    errors = document["error"]["open_loop_rmse_80"]
    assert errors["after"]["turn"] < 0.6 * errors["before"]["turn"]
    assert errors["after"]["lift"] == pytest.approx(errors["before"]["lift"], rel=0.05)
    # Of an alternative, too, by the contract: of the squared error over 80 steps that no fit saw, on its joint.
    (rival, _), *_ = correction.fit.found[0].losers
    alternative, turn = document["alternatives"][0], MACHINE.joint_names.index("turn")
    alone = hypothesis_of(diagnosis.simulation, [SelectedEffect(rival)])
    with_rival = ActiveEffects(diagnosis.nominal.setting, alone.values, {})
    after = held_out_errors(logs, predictor(*model, with_rival), 80).rmse[turn]
    expected = 1.0 - (after / errors["before"]["turn"]) ** 2
    assert (alternative["joints"], rival.joint) == (["turn"], turn)
    assert alternative["error_reduction"] == pytest.approx(expected, abs=1e-3)
    again = predictor(*model, active_effects(diagnosis.simulation, []))
    np.testing.assert_array_equal(
        again.predict(measured[0], np.array([40, 60]), 20),
        predictor(*model, None).predict(measured[0], np.array([40, 60]), 20),
    )


def with_channels(name: str, seed: int, n_rows: int) -> Trajectory:
    """Speeds are in proportion to an engine speed that hunts; oil warms up beside it."""
    random, kept = np.random.default_rng(seed), np.exp(-DT_S / 6.0)
    noise = 160.0 * np.sqrt(1.0 - kept**2) * random.standard_normal(n_rows)
    rpm = 2000.0 + np.array(list(itertools.accumulate(noise, lambda x, e: kept * x + e)))
    oil = 45.0 - 25.0 * np.exp(-DT_S * np.arange(n_rows) / 100.0) + 0.2 * random.standard_normal(n_rows)
    log = record(name, seed, n_rows, factor=rpm[:, None] / 2000.0)
    return replace(log, channels={"rpm": rpm, "oil": oil})


@pytest.mark.long
def test_the_channel_that_carries_the_cause_is_named_and_corrected_for(nominal, model, usual) -> None:  # type: ignore[no-untyped-def]
    measured = [with_channels(f"measured_{seed}", seed, 4000) for seed in (11, 12)]
    loop = close_loop(nominal, measured, MACHINE, model, *settings(), nominal_behaviour=usual)
    (effect,) = loop.document["effects"]
    assert effect["depends_on"] == ["channel:rpm"] and effect["joints"] == ["lift", "turn"]
    assert loop.effects is not None
    rpm, _ = loop.effects.setting.channels
    part = (rpm.upper - rpm.lower) / OnChannel.n_basis / 2000.0
    of_rpm = np.stack([np.full(OnChannel.n_basis, part), np.zeros(OnChannel.n_basis)])
    true = {OnChannel.card.family: {"coefficients": np.broadcast_to(of_rpm, (2, 2, 2, OnChannel.n_basis))}}
    oracle = predictor(*model, replace(loop.effects, values=true))
    logs = prepare(nominal, measured, MACHINE, *settings())
    before, after, best = (
        held_out_errors(logs, of, 80).rmse
        for of in (predictor(*model, None), predictor(*model, loop.effects), oracle)
    )
    assert np.all(before**2 - after**2 > 0.85 * (before**2 - best**2)) and np.all(best < 0.9 * before)


@pytest.mark.long
def test_what_sets_in_mid_way_is_found_with_its_moment(nominal, model, usual) -> None:  # type: ignore[no-untyped-def]
    onset = 2400
    measured = [
        record("measured_1", 11, 4000, slower=0.6, onset=onset),
        record("measured_2", 12, 4000, slower=0.6),
    ]
    document = close(nominal, measured, model, usual)
    assert document["verdict"] == "named"
    (effect,) = document["effects"]
    assert (effect["family"], effect["of"], effect["joints"]) == ("change_point", "gain", ["turn"])
    assert effect["parameters"]["speed_ratio"]["value"] == pytest.approx(0.6, abs=0.05)
    assert effect["onset"]["trajectory"] == "measured_1"
    assert effect["onset"]["t"] == pytest.approx(DT_S * onset, abs=10.0)


@pytest.mark.long
def test_a_channel_that_is_late_from_mid_way_on_is_one_cause(nominal, model, usual) -> None:  # type: ignore[no-untyped-def]
    onset, late_rows = 2400, 3
    measured = [
        record("measured_1", 11, 4000, late_rows=late_rows, onset=onset),
        record("measured_2", 12, 4000, late_rows=late_rows),
    ]
    document = close(nominal, measured, model, usual)
    assert document["verdict"] == "named"
    (effect,) = document["effects"]
    assert (effect["family"], effect["of"], effect["joints"]) == ("change_point", "timing", ["lift", "turn"])
    latency = effect["parameters"]["latency"]
    assert latency["value"] == pytest.approx(DT_S * late_rows, abs=0.02)
    # Each log may have begun anywhere between two ticks: no latency is known better than that.
    lower, upper = latency["ci95"]
    assert upper - lower > 2 * 1.96 * DT_S * np.sqrt((1 / 2 + 1 / 2) / 12)


@pytest.mark.long
def test_a_leak_slows_its_joint_under_way_and_is_one_effect(nominal, model, usual) -> None:  # type: ignore[no-untyped-def]
    sag = (-0.02, -0.04, -0.05)
    document = close(
        nominal, [record(f"measured_{seed}", seed, 4000, sag=sag) for seed in (11, 12)], model, usual
    )
    (effect,) = document["effects"]
    assert (document["verdict"], effect["family"], effect["joints"]) == ("named", "leakage", ["lift"])
    found = {name: quantity["value"] for name, quantity in effect["parameters"].items()}
    assert found["sag_rate"] == pytest.approx(-0.04, rel=0.1)
    assert found["share_in_negative_motion"] == pytest.approx(0.5, abs=0.25)
    assert found["share_in_positive_motion"] == pytest.approx(1.25, abs=0.25)


@pytest.mark.long
def test_nothing_is_found_where_nothing_changed(nominal, model, usual) -> None:  # type: ignore[no-untyped-def]
    document = close(nominal, [record("measured_1", 21, 4000), record("measured_2", 22, 4000)], model, usual)
    assert document["verdict"] == "none"
    assert document["detected"] is False
    assert document["effects"] == []
    assert document["error"]["open_loop_rmse_80"]["before"] == document["error"]["open_loop_rmse_80"]["after"]


def test_logs_too_short_to_hold_anything_back_are_refused_at_once(nominal, model) -> None:  # type: ignore[no-untyped-def]
    measured = [record("measured", 31, 300)]
    with pytest.raises(InputError, match="too short"):
        prepare(nominal, measured, MACHINE, *settings())  # before anything is learned
    with pytest.raises(InputError, match="too short"):
        close_loop(nominal, measured, MACHINE, model, *settings())
    for logs, which in (((nominal, []), "measured"), (([], measured), "nominal")):
        with pytest.raises(InputError, match=f"{which} logs: there are none"):
            close_loop(*logs, MACHINE, model, *settings())
