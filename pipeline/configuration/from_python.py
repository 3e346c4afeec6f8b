"""The pipeline's steps with the settings of a profile, as functions of folders and arrays: what `pipeline` exports.

Each does what the stage of its name does, without Hydra, DVC or MLflow. A step imports what it needs when it is called,
so that reading logs does not wait for JAX. Other settings than a profile's: call the library functions that are called
here, with `load_section`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.configuration.load import MACHINE_DIRECTORY, ControlConfiguration, load_section
from pipeline.machine.specification import MachineSpecification

if TYPE_CHECKING:
    from pipeline.control.ppo import TrainingResult
    from pipeline.discrepancy.verdict.result import ClosedLoop
    from pipeline.dynamics.evaluation.errors import PredictionErrors
    from pipeline.dynamics.training.fit import FitResult
    from pipeline.logs.ingest import IngestSummary
    from pipeline.logs.tuples import Trajectory
    from pipeline.reaching.metrics import Traces
    from pipeline.reaching.task import ReachingTask


def read_logs(machine: MachineSpecification, logs: str | Path, profile: str = "default") -> list[Trajectory]:
    """Read a folder of logs into trajectories, in memory.

    Example:
        >>> trajectories = read_logs(machine, "logs")
        >>> trajectories[0].q.shape[1] == machine.n_joint
        True

    Raises:
        InputError: The folder holds no logs, or one of them cannot be used.
    """
    from pipeline.logs.ingest_config import IngestConfig
    from pipeline.logs.trajectories import load_trajectories

    loop_tracker = load_section("control", ControlConfiguration, profile).loop_tracker
    return load_trajectories(Path(logs), machine, load_section("ingest", IngestConfig, profile), loop_tracker)


def ingest(
    machine: MachineSpecification, logs: str | Path, output: str | Path, profile: str = "default"
) -> IngestSummary:
    """Turn a folder of logs into a folder of tuples.

    Example:
        >>> summary = ingest(machine, "logs", "tuples")
        >>> summary.raise_if_failed()

    Raises:
        InputError: The folder holds no logs, or the output cannot be written.
    """
    from pipeline.logs.ingest import ingest as ingest_logs
    from pipeline.logs.ingest_config import IngestConfig

    loop_tracker = load_section("control", ControlConfiguration, profile).loop_tracker
    config = load_section("ingest", IngestConfig, profile)
    return ingest_logs(machine, Path(logs), Path(output), config, loop_tracker)


def identify(
    machine: MachineSpecification,
    tuples: str | Path,
    output: str | Path,
    kind: str = "mlp_dqdot",
    profile: str = "default",
) -> FitResult:
    """Train a dynamics model on a folder of tuples, and write its folder.

    Example:
        >>> identified = identify(machine, "tuples", "model")
        >>> Path("model/parameters.msgpack").exists()
        True

    Args:
        kind: mlp_dq, mlp_dqdot, kan_dq or kan_dqdot.

    Raises:
        InputError: The kind is not one of `identify.selected`, or the tuples cannot be used.
    """
    from pipeline.dynamics.model.dynamics_model import Target
    from pipeline.dynamics.model.network import Parameterization
    from pipeline.dynamics.model.store import save_model
    from pipeline.dynamics.settings import IdentifyConfig
    from pipeline.dynamics.training.fit import fit
    from pipeline.errors import InputError
    from pipeline.logs.tuples import read_tuples

    settings = load_section("identify", IdentifyConfig, profile)
    if kind not in settings.selected:
        raise InputError(f"identify.selected has no {kind}; it has {', '.join(settings.selected)}")
    parameterization, _, target = kind.partition("_")
    learning = read_tuples(Path(tuples), machine)
    result = fit(
        learning,
        machine,
        Parameterization(parameterization),
        Target(target),
        settings.selected[kind],
        settings,
        settings.seed,
    )
    lineage = {"trajectories": [trajectory.name for trajectory in learning], "machine": machine.name}
    save_model(Path(output), result.model, result.parameters, lineage, result.metrics, result.curves)
    return result


def evaluate(
    machine: MachineSpecification, model: str | Path, trajectories: Sequence[Trajectory]
) -> PredictionErrors:
    """Errors of a saved model, with its effects, one step ahead and over 80 steps.

    Example:
        >>> errors = evaluate(machine, "model", trajectories)
        >>> errors.one_step_rmse.shape == (machine.n_joint,)
        True

    Raises:
        InputError: The model is of another machine, or no trajectory is long enough.
    """
    from pipeline.dynamics.evaluation.errors import prediction_errors
    from pipeline.effects.store import load_predictor

    return prediction_errors(load_predictor(Path(model), machine=machine), trajectories)


def train_policy(
    machine: MachineSpecification,
    model: str | Path,
    output: str | Path,
    seed: int = 0,
    profile: str = "default",
) -> TrainingResult:
    """Learn a reaching policy on a saved model with PPO, and write its folder.

    Example:
        >>> trained = train_policy(machine, "model", "policy")
        >>> Path("policy/policy.msgpack").exists()
        True

    Raises:
        InputError: The model is of another machine, the machine has no arm or workspace, or the training diverged.
    """
    from pipeline.control.policy import save_policy
    from pipeline.control.ppo import PPOConfig, train
    from pipeline.effects.store import dynamics_fingerprint
    from pipeline.reaching.environment import ReachingEnvironment
    from pipeline.reaching.episodes import EpisodesConfig, evaluation_episodes, learning_poses

    task, arm = _task(machine, Path(model), profile)
    episodes = load_section("episodes", EpisodesConfig, profile)
    repeats = load_section("control", ControlConfiguration, profile).action_repeats
    settings = load_section("ppo", PPOConfig, profile).for_model(task.dynamics.specification)
    poses = learning_poses(machine, arm, episodes, seed)
    environment = ReachingEnvironment(task, poses, repeats, episodes.steps)
    measured_on = evaluation_episodes(machine, arm, episodes, episodes.curve_seed, settings.curve_episodes)
    result = train(environment, settings, seed, measured_on, lambda point: None, None)
    lineage = {
        "seed": seed,
        "steps": result.policy_steps,
        "machine": machine.name,
        "model": dynamics_fingerprint(Path(model)),
        "action_repeats": repeats,
    }
    save_policy(Path(output), result.policy, lineage)
    return result


def plan(
    machine: MachineSpecification, model: str | Path, n_episodes: int, seed: int = 0, profile: str = "default"
) -> Traces:
    """Plan with iCEM through the first of the fixed evaluation episodes, on the model that it plans with.

    Example:
        >>> traces = plan(machine, "model", 1)
        >>> traces.position.shape[2]
        3

    Returns:
        N = `n_episodes` episodes.

    Raises:
        InputError: The model is of another machine, or the machine has no arm or workspace.
    """
    import jax

    from pipeline.control.evaluate import controller_evaluation
    from pipeline.control.icem.config import IcemConfig
    from pipeline.control.icem.controller import icem_controller
    from pipeline.reaching.episodes import EpisodesConfig, evaluation_episodes

    task, arm = _task(machine, Path(model), profile)
    conditions = load_section("episodes", EpisodesConfig, profile)
    repeats = load_section("control", ControlConfiguration, profile).action_repeats
    episodes = evaluation_episodes(
        machine, arm, conditions, conditions.evaluation_seed, conditions.evaluation_episodes
    ).first(n_episodes)
    controller = icem_controller(task, load_section("icem", IcemConfig, profile), repeats)
    run = controller_evaluation(controller, task, repeats, conditions.steps)
    return run(None, episodes, jax.random.split(jax.random.key(seed), len(episodes.starts))).traces


def close_loop(
    machine: MachineSpecification,
    model: str | Path,
    nominal: Sequence[Trajectory],
    measured: Sequence[Trajectory],
    profile: str = "default",
) -> ClosedLoop:
    """Find what has changed between the logs that a saved model describes and newer ones.

    Example:
        >>> result = close_loop(machine, "model", trajectories, read_logs(machine, "newer_logs"))
        >>> verdict, effects = result.document["verdict"], result.document["effects"]

    Raises:
        InputError: The model is of another machine, or has effects already.
        UnusableLogs: The logs are too short.
    """
    from pipeline.discrepancy.close_loop import close_loop as close_loop_on
    from pipeline.discrepancy.settings import CloseLoopConfig
    from pipeline.effects.unaugmented_model import load_plain_model_of

    dynamics, parameters = load_plain_model_of(Path(model), machine)
    config = load_section("close_loop", CloseLoopConfig, profile)
    return close_loop_on(nominal, measured, machine, dynamics, parameters, config)


def _task(machine: MachineSpecification, model: Path, profile: str) -> tuple[ReachingTask, Any]:
    """The reaching task on a saved model, and the arm's kinematics."""
    from pipeline.effects.store import load_dynamics
    from pipeline.machine.kinematics import load_arm
    from pipeline.reaching.reward import RewardConfig
    from pipeline.reaching.task import ReachingTask

    arm = load_arm(machine, MACHINE_DIRECTORY)
    dynamics, parameters = load_dynamics(model, machine)
    return ReachingTask(
        machine, arm, dynamics, parameters, load_section("reward", RewardConfig, profile)
    ), arm
