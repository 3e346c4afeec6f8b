"""iCEM behind the graph's controller interface, against its own evaluation in Brax."""

import dataclasses
from functools import partial
from types import SimpleNamespace
from typing import Any

import jax
import numpy as np
import pytest
from flax.serialization import msgpack_restore

from pipeline.configuration.load import load_section
from pipeline.control.evaluate import controller_evaluation
from pipeline.control.icem.config import IcemConfig
from pipeline.control.icem.controller import icem_controller
from pipeline.control.icem.variant import RewardVariant, variant_reward
from pipeline.deployment import compose
from pipeline.deployment.component import Computation, nanoseconds
from pipeline.deployment.components.autonomous_server import DecisionRequest
from pipeline.deployment.components.controllers import (
    ControllerKind,
    ControllerState,
    IcemController,
    at_rest,
)
from pipeline.deployment.components.goals import goal_solver
from pipeline.deployment.components.state_buffers import StateBuffers
from pipeline.deployment.components.termination import TerminalConditions
from pipeline.deployment.compose import GraphSettings, controller_delays, planner_effort
from pipeline.deployment.drivers.machine import LearnedMachine, LearnedStep
from pipeline.deployment.messages import JointState, ReachGoal, Topic
from pipeline.deployment.transports.simulated_time.delays import (
    PLANNING,
    DelaySampler,
    Distribution,
    PlannerEffort,
    delays_of,
    load_delays,
    no_delays,
    save_delays,
)
from pipeline.deployment.trials import GraphParts, run_episodes
from pipeline.dynamics.model.dynamics import Dynamics
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.store import save_model
from pipeline.effects.augmented_model import AugmentedModel, AugmentedParameters
from pipeline.effects.chain import Chain
from pipeline.effects.delay import Delay
from pipeline.effects.effect import Setting
from pipeline.effects.gain import Gain
from pipeline.effects.lag import Lag
from pipeline.effects.store import ActiveEffects, save_effects
from pipeline.errors import InputError
from pipeline.reaching.episodes import Episodes
from pipeline.reaching.logged_trials import trial_traces
from pipeline.reaching.reward import RewardConfig
from pipeline.reaching.task import ReachingTask
from tests.deployment.machines import MIDDLE, arm, bobcat, paper, specification
from tests.reaching.lag import lag_dynamics

TICKS, REPEATS, SEED = 20, 4, 3
EPISODES = Episodes(
    np.array([MIDDLE, MIDDLE + 0.1], np.float32),
    np.array([MIDDLE + np.array([0.3, -0.1, 0.2, 0.1]), MIDDLE - np.array([0.3, 0.1, 0.0, 0.2])], np.float32),
)


@pytest.fixture(scope="module")
def config() -> IcemConfig:
    section = load_section("icem", IcemConfig)
    return dataclasses.replace(section, horizon=3, samples=12, elites=3, iterations=2)


def parts_on(dynamics: Dynamics, parameters: Any, config: IcemConfig) -> GraphParts:
    reward = variant_reward(load_section("reward", RewardConfig), RewardVariant.icem_double_dagger)
    task = ReachingTask(bobcat(), arm(), dynamics, parameters, reward)
    return GraphParts(
        task,
        IcemController(task, config, REPEATS, SEED),
        goal_solver(bobcat(), arm()),
        TerminalConditions(bobcat(), arm(), paper().termination),
        paper(),
        action_repeats=REPEATS,
        maximum_ticks=TICKS,
        step=LearnedStep(task),
    )


@pytest.fixture(scope="module")
def parts(config: IcemConfig) -> GraphParts:
    return parts_on(lag_dynamics(bobcat()), {}, config)


@pytest.fixture(scope="module")
def parts_with_effects(config: IcemConfig) -> GraphParts:
    """Around the same model: what is in no window of measurements, commands on their way and a slow response."""
    setting = Setting(bobcat().dt_s, bobcat().lower, bobcat().upper, np.ones(bobcat().n_joint))
    chain = Chain([Delay, Lag], setting)
    values = chain.neutral()
    values["delay"]["added_delay"][:] = [0.13, 0.0, 0.2, 0.05]
    values["lag"]["added_time_constant"][:] = [0.0, 0.15, 0.1, 0.2]
    model = AugmentedModel(lag_dynamics(bobcat()), chain)
    return parts_on(model, AugmentedParameters({}, jax.tree.map(jax.numpy.float32, values)), config)


@pytest.fixture(scope="module")
def undelayed(parts: GraphParts):
    return trial_traces(run_episodes(parts, no_delays(), EPISODES), bobcat(), arm())


@pytest.mark.long
@pytest.mark.parametrize("on", ["parts", "parts_with_effects"])
def test_planning_in_a_graph_without_delays_is_planning_in_brax(on, config, request) -> None:
    """Command for command: the buffers hold what the model's own history holds, and plans move on alike."""
    parts = request.getfixturevalue(on)
    undelayed = trial_traces(run_episodes(parts, no_delays(), EPISODES), bobcat(), arm())
    evaluate = controller_evaluation(icem_controller(parts.task, config, REPEATS), parts.task, REPEATS, TICKS)
    keys = jax.vmap(lambda n: jax.random.fold_in(jax.random.key(SEED), n))(np.arange(2))
    brax = evaluate(None, EPISODES, keys).traces
    for n in range(2):
        waited = int(np.argmax(undelayed.command[n].any(axis=1)) - np.argmax(brax.command[n].any(axis=1)))
        assert 0 <= waited <= 2
        np.testing.assert_array_equal(undelayed.command[n, waited:], brax.command[n, : TICKS - waited])


@pytest.mark.long
def test_episodes_side_by_side_are_what_they_are_alone(parts, undelayed) -> None:
    together = trial_traces(run_episodes(parts, no_delays(), EPISODES, threads=2), bobcat(), arm())
    np.testing.assert_array_equal(together.q, undelayed.q)


def test_a_goal_s_number_decides_its_samples_and_a_fresh_planner_remembers_nothing(parts) -> None:
    start = EPISODES.starts[0]
    n_rows = parts.task.dynamics.specification.lags + 1
    still = ControllerState(
        np.zeros((n_rows, 4), np.float32), np.zeros((n_rows, 4), np.float32), start, start + 0.2
    )
    plans = []
    for goal_id in (0, 0, 1):
        planner = parts.controller.fresh()
        planner.begin(goal_id)
        planner.decide(still)
        plans.append(np.asarray(planner._plan.proposal.mean))
    np.testing.assert_array_equal(plans[0], plans[1])
    assert not np.array_equal(plans[0], plans[2])


def test_a_planner_that_sees_no_number_answers_none(parts) -> None:
    n_rows = parts.task.dynamics.specification.lags + 1
    motion = np.full((n_rows, 4), np.nan, np.float32)
    q = EPISODES.starts[0]
    blind = ControllerState(motion, np.zeros((n_rows, 4), np.float32), q, q)
    assert np.isnan(parts.controller.fresh().decide(blind)).all()


def test_what_the_server_estimates_of_a_model_with_effects_is_what_the_model_knows(
    parts_with_effects,
) -> None:
    """Through the velocity and the position that a machine tells, and one reading in between that is no number."""
    task, random = parts_with_effects.task, np.random.default_rng(0)
    machine = LearnedMachine(parts_with_effects.step, MIDDLE)
    buffers = StateBuffers(task.dynamics.specification, parts_with_effects.controller.observer)
    buffers.push(*(np.float32(row) for row in (MIDDLE, np.zeros(4), np.zeros(4))))
    for tick in range(40):
        if tick % 5 == 0:
            command = random.integers(-1, 2, 4).astype(np.float32)
        (sample,) = machine.advance(command)
        buffers.push(sample.position, sample.velocity, command)
    known, found = machine._history, buffers.history
    assert np.abs(known.nominal.motion[-1] - known.motion[-1]).max() > 0.05  # the effects show
    np.testing.assert_array_equal(found.commands, buffers.commands)
    for name in ("motion", "q", "nominal", "chain"):
        jax.tree.map(
            partial(np.testing.assert_allclose, atol=1e-4), getattr(found, name), getattr(known, name)
        )
    buffers.push(np.full(4, np.nan), np.zeros(4), command)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(buffers.history))


def test_a_planner_on_a_model_with_effects_sees_commands_that_are_on_their_way(parts_with_effects) -> None:
    """Twice the same measured window, in which nothing moves: once more commands are still to come."""
    task, planner = parts_with_effects.task, parts_with_effects.controller.fresh()
    start = EPISODES.starts[0]
    still = at_rest(task, start, start + 0.2, planner.observer)
    under_way = jax.tree.map(lambda leaf: leaf, still.history)
    under_way.chain["delay"] = np.ones_like(under_way.chain["delay"])
    returns = []
    for state in (still, still._replace(history=under_way)):
        planner.begin(0)
        planner.decide(state)
        returns.append(np.asarray(planner._plan.elites.returns))
    assert np.abs(returns[0] - returns[1]).max() > 0.1


def settings_with(**own: Any) -> GraphSettings:
    names = (field.name for field in dataclasses.fields(GraphSettings))
    return GraphSettings(**(dict.fromkeys(names) | own))


def test_one_controller_is_named_and_no_more() -> None:
    assert settings_with(policy="ppo").kind is ControllerKind.ppo
    assert settings_with(variant=RewardVariant.icem).kind is ControllerKind.icem
    for policy, variant in ((None, None), ("ppo", RewardVariant.icem)):
        with pytest.raises(InputError, match="name one controller"):
            _ = settings_with(policy=policy, variant=variant).kind


def test_a_planner_s_decisions_take_their_own_time(tmp_path) -> None:
    measured = no_delays() | {"inference": Distribution.constant(0.001)}
    policy, is_measured = delays_of(measured, ControllerKind.ppo, None)
    assert is_measured and policy["inference"] is measured["inference"]
    assumed, is_measured = delays_of(measured, ControllerKind.icem, 0.05)
    assert not is_measured
    assert DelaySampler(assumed["inference"], np.random.SeedSequence(0)).draw_ns() == nanoseconds(0.05)
    with pytest.raises(InputError, match="unmeasured_planning_s"):
        delays_of(measured, ControllerKind.icem, None)
    save_delays(tmp_path / "delays.json", measured | {PLANNING: Distribution.constant(0.2)}, {})
    planner, is_measured = delays_of(load_delays(tmp_path / "delays.json").links, ControllerKind.icem, 0.05)
    assert is_measured and planner["inference"].quantiles_s[0] == 0.2


def test_a_file_of_delays_says_of_which_planner_it_is(tmp_path) -> None:
    path, effort = tmp_path / "delays.json", PlannerEffort(model_steps=5984, model_parameters=14468)
    save_delays(path, no_delays() | {PLANNING: Distribution.constant(0.2)}, {"planner": effort._asdict()})
    assert load_delays(path).planner == effort
    save_delays(path, no_delays() | {PLANNING: Distribution.constant(0.2)}, {})
    assert load_delays(path).planner is None


def test_delays_of_another_planner_are_not_this_one_s(tmp_path, capsys, monkeypatch) -> None:
    path, effort = tmp_path / "delays.json", PlannerEffort(model_steps=5984, model_parameters=14468)
    save_delays(path, no_delays() | {PLANNING: Distribution.constant(0.2)}, {"planner": effort._asdict()})
    deployment = SimpleNamespace(delays=str(path), unmeasured_planning_s=0.09)
    settings = settings_with(variant=RewardVariant.icem, deployment=deployment, machine_directory=tmp_path)
    monkeypatch.setattr(compose, "planner_effort", lambda _: effort)
    assert controller_delays(settings)["inference"].quantiles_s[0] == 0.2
    assert not capsys.readouterr().out
    monkeypatch.setattr(compose, "planner_effort", lambda _: effort._replace(model_steps=200_000))
    assert controller_delays(settings)["inference"].quantiles_s[0] == 0.09
    assert "0.09 s" in capsys.readouterr().out


def test_a_decision_costs_what_the_network_does_whatever_effects_lie_around_it(
    tmp_path, config: IcemConfig
) -> None:
    model = DynamicsModel(specification())
    save_model(tmp_path, model, model.initialise(jax.random.key(0)), {}, {}, {})
    settings = settings_with(model=str(tmp_path), icem=config, action_repeats=REPEATS)
    n_saved = sum(
        value.size
        for value in jax.tree.leaves(msgpack_restore((tmp_path / "parameters.msgpack").read_bytes()))
    )
    effort = PlannerEffort(config.model_steps(REPEATS), n_saved)
    assert planner_effort(settings) == effort
    setting = Setting(bobcat().dt_s, bobcat().lower, bobcat().upper, np.ones(bobcat().n_joint))
    slower = {"ratio_positive": np.full(bobcat().n_joint, 0.7)}
    save_effects(tmp_path, ActiveEffects(setting, {"gain": Gain(setting).neutral() | slower}, {}))
    assert planner_effort(settings) == effort


def test_nothing_is_compiled_once_a_server_has_rehearsed(parts: GraphParts) -> None:
    server, q = parts.server(), EPISODES.starts[0]
    pose = jax.device_get(parts.task.arm.forward(EPISODES.targets[0]))
    server.rehearse(at_rest(parts.task, q, q, parts.controller.observer), *pose)
    compiled: list[str] = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda event, duration, **_: compiled.append(event) if "backend_compile" in event else None
    )
    try:
        server.on_message(Topic.joint_states, JointState(0, q, np.zeros_like(q)), 0)
        server.on_message(Topic.goal, ReachGoal(7, *pose), 0)
        decisions = 0
        for tick in range(1, 3 * REPEATS):
            now_ns = tick * nanoseconds(parts.task.machine.dt_s)
            for output in server.on_timer(now_ns):
                if isinstance(output, Computation):
                    decisions += isinstance(output.request, DecisionRequest)
                    server.on_computed(server.compute(output.request), now_ns)
    finally:
        jax.monitoring.clear_event_listeners()
    assert decisions > 1
    assert compiled == []
