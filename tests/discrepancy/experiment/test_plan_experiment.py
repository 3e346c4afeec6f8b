"""An experiment is planned for what logs did not show, played on the machine, and shows it."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.discrepancy.close_loop import close_loop
from pipeline.discrepancy.diagnosis.nominal_behaviour import NominalBehaviour, learn_nominal_behaviour
from pipeline.discrepancy.experiment.plan import Plan
from pipeline.discrepancy.experiment.player import PlanPlayer
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.discrepancy.verdict.result import ClosedLoop
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import JointSpecification, MachineSpecification

pytestmark = [pytest.mark.slow, pytest.mark.long]

MACHINE = MachineSpecification(
    name="two_joints",
    rate_hz=20.0,
    joints=[JointSpecification("lift", -1.0, 1.0), JointSpecification("turn", -2.0, 2.0)],
)
SPEEDS, CONSTANTS_S, DT_S = np.array([0.4, 0.6]), np.array([0.2, 0.3]), 0.05
LIFT, TURN = 0, 1


class Operator:
    """Random holds of commands on the joints named, away from the ends of their ranges."""

    def __init__(self, seed: int, joints: tuple[int, ...], n_rows: int) -> None:
        self._random = np.random.default_rng(seed)
        self._joints, self._rows_left = joints, n_rows
        self._command, self._held = np.zeros(2), np.zeros(2)

    @property
    def is_done(self) -> bool:
        return self._rows_left <= 0

    def command(self, measured: np.ndarray) -> np.ndarray:
        self._rows_left -= 1
        for joint in self._joints:
            self._held[joint] -= 1
            if self._held[joint] <= 0:
                self._command[joint] = self._random.choice([-1.0, 0.0, 1.0])
                self._held[joint] = self._random.integers(4, 40)
            if abs(measured[joint]) > 0.8 * MACHINE.upper[joint]:
                self._command[joint] = -np.sign(measured[joint])
        return self._command.copy()


def record(name: str, seed: int, operator: Operator | PlanPlayer, slower: float = 1.0) -> Trajectory:
    """First-order joints; `lift` is slower by a factor on its way up."""
    random = np.random.default_rng(seed)
    visited, commands = [np.zeros(2)], []
    velocity = np.zeros(2)
    while not operator.is_done:
        command = operator.command(visited[-1])
        target = SPEEDS * command
        target[LIFT] *= slower if command[LIFT] > 0 else 1.0
        velocity = velocity + (1.0 - np.exp(-DT_S / CONSTANTS_S)) * (target - velocity)
        commands.append(command)
        visited.append(visited[-1] + DT_S * velocity)
    a = np.array(commands)
    q = np.array(visited[: len(a)]) + 5e-4 * random.standard_normal(a.shape)
    t_s = DT_S * np.arange(len(a))
    stamp_ns = (1_000_000_000 * (1000 * seed + t_s)).astype(np.int64)
    qd = np.gradient(q, DT_S, axis=0)
    return Trajectory(name, t_s, stamp_ns, q, qd, a, np.arange(len(a)) >= 0.9 * len(a))


def settings() -> tuple[CloseLoopConfig, IdentifyConfig]:
    """With a smaller budget of the diagnosis model."""
    identify = load_section("identify", IdentifyConfig, "paper")
    training = replace(identify.training_of("nfir_dqdot"), maximum_epochs=80)
    identify = replace(identify, selected={"nfir_dqdot": training})
    return load_section("close_loop", CloseLoopConfig, "paper"), identify


@pytest.fixture(scope="module")
def nominal() -> list[Trajectory]:
    return [record(f"nominal_{seed}", seed, Operator(seed, (LIFT, TURN), 5000)) for seed in (1, 2)]


@pytest.fixture(scope="module")
def usual(nominal: list[Trajectory]) -> NominalBehaviour:
    return learn_nominal_behaviour(nominal, MACHINE, *settings())


def close(nominal: list[Trajectory], measured: list[Trajectory], usual: NominalBehaviour) -> ClosedLoop:
    return close_loop(nominal, measured, MACHINE, None, *settings(), nominal_behaviour=usual)


@pytest.fixture(scope="module")
def first(nominal: list[Trajectory], usual: NominalBehaviour) -> tuple[list[Trajectory], Plan]:
    """Logs in which `lift`, which has changed, never moves, and the plan that they lead to."""
    measured = [record("measured", 11, Operator(11, (TURN,), 4000), slower=0.7)]
    result = close(nominal, measured, usual)
    assert result.document["verdict"] in ("none", "unexcited"), result.document["effects"]
    assert result.plan is not None and result.document["next_experiment"] == result.plan.sentence
    return measured, result.plan


def test_the_plan_moves_what_was_not_seen_to_move(first: tuple[list[Trajectory], Plan]) -> None:
    plan = first[1]
    asked = [step.seconds for step in plan.steps if "lift" in step.command]
    others = [step.seconds for step in plan.steps if step.command and "lift" not in step.command]
    assert sum(asked) > sum(others)
    assert plan.motion_s <= settings()[0].experiment.motion_s
    told = {of.explanations[0]: of.evidence for of in plan.separations}
    assert told["gain (lift)"] > 7.0 and "gain (turn)" not in told  # the logs have shown that


def test_played_it_stays_inside_and_shows_what_had_changed(
    first: tuple[list[Trajectory], Plan], nominal: list[Trajectory], usual: NominalBehaviour
) -> None:
    measured, plan = first
    new = record("experiment", 12, PlanPlayer(MACHINE, plan), slower=0.7)
    bounds = np.array([plan.envelope.joints[name] for name in MACHINE.joint_names])
    assert np.all((new.q >= bounds[:, 0]) & (new.q <= bounds[:, 1]))
    document = close(nominal, [*measured, new], usual).document
    assert document["detected"]
    assert [of["joints"] for of in document["effects"]] == [["lift"]]
