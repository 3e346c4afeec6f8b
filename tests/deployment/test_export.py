"""An exported policy decides as the deployed components do, on machines of several kinds."""

import ctypes
import dataclasses
import itertools
import shutil
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

from benchmarks.exported_policy import CompiledPolicy
from pipeline.configuration.load import load_section
from pipeline.control.policy import Policy, PolicyLayer, save_policy
from pipeline.deployment.component import nanoseconds
from pipeline.deployment.components.controllers import ControllerState, PolicyController, measured
from pipeline.deployment.components.state_buffers import StateBuffers
from pipeline.deployment.components.velocity_estimator import VelocityEstimator
from pipeline.deployment.export.c_file import policy_as_c
from pipeline.deployment.export.exported import ExportedPolicy
from pipeline.deployment.export.onnx_file import COMMAND, OBSERVATION, PROTO_ACTION, policy_as_onnx
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.specification import Target
from pipeline.dynamics.model.store import save_model
from pipeline.effects.store import dynamics_fingerprint
from pipeline.errors import InputError
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.machine.kinematics import Arm
from pipeline.machine.specification import CommandKind
from pipeline.reaching.reward import RewardConfig
from pipeline.reaching.task import ReachingTask
from tests.deployment.machines import arm, bobcat
from tests.machine.crane import crane
from tests.reaching.lag import model_specification
from tests.stages.command import run_stage

N_DECISIONS, ACTION_REPEATS = 400, 4
TRACKER = LoopTrackerConfig(10.0, 60.0)
ROUNDING = 1e-5  # of proto-actions, in float32
WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror")
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler `cc`")


def random_policy(n_in: int, n_joint: int, *, normalised: bool) -> Policy:
    """Of weights that spread proto-actions over (-1, 1)."""
    random = np.random.default_rng(0)
    widths = (n_in, 32, 24, 2 * n_joint)
    layers = tuple(
        PolicyLayer(random.normal(0, 2 / np.sqrt(a), (a, b)), random.normal(0, 0.3, b))
        for a, b in itertools.pairwise(widths)
    )
    mean = random.normal(0, 0.3, n_in) if normalised else np.zeros(n_in)
    std = random.uniform(0.5, 2.0, n_in) if normalised else np.ones(n_in)
    return jax.tree.map(lambda values: jax.numpy.asarray(values, "float32"), Policy(mean, std, layers))


def of_bobcat() -> ReachingTask:
    return task_of(bobcat(), arm(), Target.dqdot, lags=18)


def of_crane() -> ReachingTask:
    return task_of(*crane(), Target.dq, lags=3)


def task_of(machine, arm: Arm, target: Target, lags: int) -> ReachingTask:
    model = DynamicsModel(model_specification(machine, target, lags))
    return ReachingTask(machine, arm, model, {}, load_section("reward", RewardConfig))


@pytest.fixture(scope="module", params=[of_bobcat, of_crane])
def exported(request: pytest.FixtureRequest) -> ExportedPolicy:
    task = request.param()
    policy = random_policy(task.observation_size, task.machine.n_joint, normalised=request.param is of_bobcat)
    return ExportedPolicy(policy, task, TRACKER, ACTION_REPEATS, ("From a test.",))


@pytest.fixture(scope="module")
def source(exported: ExportedPolicy) -> str:
    return policy_as_c(exported)


@pytest.fixture(scope="module")
def compiled(
    exported: ExportedPolicy, source: str, tmp_path_factory: pytest.TempPathFactory
) -> CompiledPolicy:
    return CompiledPolicy(source, exported, tmp_path_factory.mktemp("compiled"), *WARNINGS)


@dataclasses.dataclass
class Deployed:
    """What the graph's components made of positions: commands before each tick, and the decisions."""

    q: np.ndarray
    before: np.ndarray
    target: np.ndarray
    observations: np.ndarray
    proto_actions: np.ndarray
    commands: np.ndarray


@pytest.fixture(scope="module")
def deployed(exported: ExportedPolicy) -> Deployed:
    """A joint wanders over its range as the components decide."""
    task, machine = exported.task, exported.task.machine
    lower, upper = np.asarray(machine.lower), np.asarray(machine.upper)
    tick, joint = np.arange(N_DECISIONS * ACTION_REPEATS)[:, None], np.arange(machine.n_joint)
    share = 0.5 + 0.3 * np.sin(tick / (17.0 + 5 * joint)) + 0.15 * np.sin(tick / (4.3 + joint))
    q = (lower + share * (upper - lower)).astype(np.float32)
    target = (lower + 0.3 * (upper - lower)).astype(np.float32)

    controller = PolicyController(task, exported.policy)
    buffers = StateBuffers(task.dynamics.specification)
    period_ns = nanoseconds(machine.dt_s)
    estimator = VelocityEstimator(period_ns, TRACKER)

    @jax.jit
    def look(state: ControllerState):
        observation = task.observe(measured(task, state))
        return observation, exported.policy.act(observation)

    command, before, decisions = np.zeros(machine.n_joint, np.float32), [], []
    for number, position in enumerate(q):
        buffers.push(position, estimator.update(number * period_ns, position.astype(float)), command)
        before.append(command)
        if number % ACTION_REPEATS == 0:
            state = ControllerState(buffers.motion.copy(), buffers.commands.copy(), position, target)
            command = controller.decide(state)
            decisions.append((*look(state), command))
    return Deployed(q, np.array(before), target, *map(np.array, zip(*decisions, strict=True)))


def assert_same_commands(exported: ExportedPolicy, deployed: Deployed, proto_actions, commands) -> None:
    np.testing.assert_allclose(proto_actions, deployed.proto_actions, rtol=0, atol=ROUNDING)
    if exported.task.machine.command_kind is CommandKind.continuous:
        np.testing.assert_allclose(commands, deployed.commands, rtol=0, atol=ROUNDING)
        return
    assert set(np.unique(deployed.commands)) == {-1.0, 0.0, 1.0}
    sure = np.abs(np.abs(deployed.proto_actions) - 0.5) > ROUNDING
    assert sure.mean() > 0.99
    np.testing.assert_array_equal(commands[sure], deployed.commands[sure])


@needs_compiler
def test_c_file_decides_as_the_graphs_components(exported, compiled, deployed) -> None:
    has_fault, decided = compiled.run_episode(deployed.q, deployed.target, deployed.before)
    assert not has_fault
    assert_same_commands(exported, deployed, decided.proto_action, decided.command)


@needs_compiler
def test_c_file_tests_itself_and_tells_its_sizes(exported, source, compiled, tmp_path) -> None:
    assert compiled.functions.policy_self_test() == 0
    assert f"a policy_state {compiled.functions.state_bytes()}," in source
    wrong = source.replace("2.0f * (value - lower)", "2.1f * (value - lower)")
    assert CompiledPolicy(wrong, exported, tmp_path).functions.policy_self_test() == 1


@needs_compiler
def test_c_file_decides_at_a_new_target_and_faults_on_what_is_not_finite(exported, compiled) -> None:
    n, step = exported.task.machine.n_joint, compiled.functions.policy_step
    is_discrete = exported.task.machine.command_kind is CommandKind.discrete
    state = ctypes.create_string_buffer(compiled.functions.state_bytes())
    middle = 0.5 * (np.asarray(exported.task.machine.lower) + exported.task.machine.upper)
    q, command = middle.astype(np.float32), np.zeros(n, np.int8 if is_discrete else np.float32)
    mark = np.full(n, 1 if is_discrete else 0.123, command.dtype)

    def has_decided(target: np.ndarray, q: np.ndarray = q) -> tuple[int, bool]:
        command[:] = mark
        given = (array.ctypes.data_as(ctypes.c_void_p) for array in (q, target, command))
        fault = step(state, *given)
        return fault, not np.array_equal(command, mark)

    compiled.functions.policy_init(state)
    target = (q + 0.2).astype(np.float32)
    calls = [has_decided(target) for _ in range(ACTION_REPEATS + 1)]
    assert calls == [(0, True)] + [(0, False)] * (ACTION_REPEATS - 1) + [(0, True)]
    assert has_decided(target) == (0, False)
    assert has_decided(q) == (0, True)
    broken = np.where(np.arange(n) == n - 1, np.nan, q).astype(np.float32)
    assert has_decided(q, broken) == (1, True) and not command.any()
    assert has_decided(broken) == (1, True) and not command.any()
    assert has_decided(q) == (0, True)


@pytest.fixture(params=["onnx.reference", "onnxruntime"])
def run_onnx(request: pytest.FixtureRequest):
    runtime = pytest.importorskip(request.param)

    def run(content: bytes, observations: np.ndarray) -> list[np.ndarray]:
        session = (
            runtime.ReferenceEvaluator(pytest.importorskip("onnx").load_from_string(content))
            if request.param == "onnx.reference"
            else runtime.InferenceSession(content, providers=["CPUExecutionProvider"])
        )
        return session.run([PROTO_ACTION, COMMAND], {OBSERVATION: observations})

    return run


def test_onnx_decides_as_the_policy(exported, deployed, run_onnx) -> None:
    content = policy_as_onnx(exported)
    assert content == policy_as_onnx(exported)
    assert_same_commands(exported, deployed, *run_onnx(content, deployed.observations))


def test_onnx_says_what_an_observation_is_made_of(exported) -> None:
    layout = exported.observation_layout()
    assert sum(np.prod(shape) for _, shape in layout) == exported.policy.observation_size
    pytest.importorskip("onnx")
    assert exported.task.machine.joint_names[0].encode() in policy_as_onnx(exported)


def test_without_onnx_the_remedy_is_told(exported, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(InputError, match="onnx is missing"):
        policy_as_onnx(exported)


def test_weights_that_are_not_finite_are_refused(exported) -> None:
    broken = exported.policy._replace(mean=exported.policy.mean.at[0].set(np.nan))
    with pytest.raises(InputError, match="not all finite"):
        dataclasses.replace(exported, policy=broken)


def test_stage_writes_the_file_and_refuses_another_models_policy(tmp_path: Path) -> None:
    task = of_bobcat()
    for seed in (0, 1):
        parameters = task.dynamics.initialise(jax.random.key(seed))
        save_model(tmp_path / f"model_{seed}", task.dynamics, parameters, {}, {}, {})
    policy = random_policy(task.observation_size, task.machine.n_joint, normalised=True)
    save_policy(tmp_path / "policy", policy, {"model": dynamics_fingerprint(tmp_path / "model_0")})
    result = run_stage("export_policy", "model=model_0", "policy=policy", "output=out", folder=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "int policy_step(" in (tmp_path / "out" / "policy.c").read_text()
    result = run_stage("export_policy", "model=model_1", "policy=policy", "output=out", folder=tmp_path)
    assert result.returncode == 2 and "was not learned on model_1" in result.stderr
