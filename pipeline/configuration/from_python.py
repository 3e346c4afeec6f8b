"""The pipeline's steps with the settings of a profile, as functions of folders and arrays: what `pipeline` exports.

They know nothing of Hydra, DVC and MLflow. `ingest`, `identify` and `train_policy` write a folder; the others return
their result. A step imports what it needs when it is called, so that reading logs does not wait for JAX. Other settings
than a profile's: call the library functions that are called here, with `load_section`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.configuration.load import MACHINE_DIRECTORY, ControlConfiguration, load_section
from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification

if TYPE_CHECKING:
    from pipeline.control.train_policy import TrainedPolicy
    from pipeline.discrepancy.verdict.result import ClosedLoop
    from pipeline.dynamics.evaluation.errors import PredictionErrors
    from pipeline.dynamics.identify import Identified
    from pipeline.logs.ingest import IngestSummary
    from pipeline.logs.tuples import Trajectory
    from pipeline.reaching.metrics import Traces
    from pipeline.reaching.settings import ReachingSettings


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
    held_out: str | Path | None = None,
    profile: str = "default",
) -> Identified:
    """Train a dynamics model on a folder of tuples, judge it, and write its folder.

    Example:
        >>> identified = identify(machine, "tuples", "model")
        >>> Path("model/parameters.msgpack").exists()
        True

    Args:
        kind: mlp_dq, mlp_dqdot, kan_dq, kan_dqdot or nfir_dqdot.
        held_out: Folder of tuples to judge on; None: the validation rows.

    Raises:
        InputError: The kind is not one of `identify.selected`, or the tuples cannot be used.
    """
    from pipeline.dynamics.identify import identify as identify_on
    from pipeline.dynamics.model.dynamics_model import Target
    from pipeline.dynamics.model.network import Parameterization
    from pipeline.dynamics.settings import IdentifyConfig
    from pipeline.dynamics.training.data_split import split_by_purpose

    settings = load_section("identify", IdentifyConfig, profile)
    settings.training_of(kind)  # before the tuples are read
    parameterization, _, target = kind.partition("_")
    rows = split_by_purpose(tuples, held_out, [], machine)
    identified = identify_on(rows, machine, Parameterization(parameterization), Target(target), settings)
    identified.save(Path(output))
    return identified


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
    algorithm: str = "ppo",
) -> TrainedPolicy:
    """Learn a reaching policy on a saved model, and write its folder.

    Example:
        >>> trained = train_policy(machine, "model", "policy")
        >>> Path("policy/policy.msgpack").exists()
        True

    Args:
        algorithm: ppo, or apg, the gradient through the model.

    Raises:
        InputError: The model cannot be read, the machine has no arm or workspace, or the training diverged.
    """
    from pipeline.control.train_policy import train_policy as train_on
    from pipeline.effects.store import load_dynamics

    place, reaching = Path(model), _reaching(machine, profile)
    if algorithm == "ppo":
        from pipeline.control import ppo

        specification = load_dynamics(place)[0].specification
        config = load_section("ppo", ppo.PPOConfig, profile).for_model(specification)
        trained = train_on(place, reaching, ppo.train, config, seed)
    elif algorithm == "apg":
        from pipeline.control.apg.config import APGConfig
        from pipeline.control.apg.training import train

        trained = train_on(place, reaching, train, load_section("apg", APGConfig, profile), seed)
    else:
        raise InputError(f"algorithm {algorithm} is not known; use ppo or apg")
    trained.save(Path(output))
    return trained


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
        InputError: The model cannot be read, or the machine has no arm or workspace.
    """
    from pipeline.control.evaluate_planner import evaluate_planner
    from pipeline.control.icem.config import IcemConfig
    from pipeline.control.icem.variant import RewardVariant

    reaching = _reaching(machine, profile)
    episodes, icem = reaching.fixed_episodes(n_episodes), load_section("icem", IcemConfig, profile)
    traces, _ = evaluate_planner(Path(model), reaching, icem, RewardVariant.icem, episodes, seed)
    return traces


def _reaching(machine: MachineSpecification, profile: str) -> ReachingSettings:
    from pipeline.machine.kinematics import load_arm
    from pipeline.reaching.episodes import EpisodesConfig
    from pipeline.reaching.reward import RewardConfig
    from pipeline.reaching.settings import ReachingSettings

    return ReachingSettings(
        machine,
        load_arm(machine, MACHINE_DIRECTORY),
        load_section("reward", RewardConfig, profile),
        load_section("episodes", EpisodesConfig, profile),
        load_section("control", ControlConfiguration, profile).action_repeats,
    )


def close_loop(
    machine: MachineSpecification,
    model: str | Path | None,
    nominal: Sequence[Trajectory],
    measured: Sequence[Trajectory] | None,
    profile: str = "default",
) -> ClosedLoop:
    """Find what has changed between the logs that a model describes and newer ones.

    Example:
        >>> result = close_loop(machine, "model", trajectories, read_logs(machine, "newer_logs"))
        >>> verdict, effects = result.document["verdict"], result.document["effects"]

    Args:
        model: Folder of the model, which may have effects already; None: one of kind nfir_dqdot is identified from
            `nominal`.
        measured: Newer logs; None: what the model lacks of `nominal`.

    Raises:
        InputError: The model is of another machine; neither it nor newer logs are given.
        UnusableLogs: The logs are too short.
    """
    from pipeline.discrepancy.close_loop import close_loop as close_loop_on
    from pipeline.discrepancy.nominal_model import given_model
    from pipeline.discrepancy.settings import CloseLoopConfig
    from pipeline.dynamics.settings import IdentifyConfig

    of_model, given = given_model(None if model is None else Path(model), machine)
    config = load_section("close_loop", CloseLoopConfig, profile)
    identify = load_section("identify", IdentifyConfig, profile)
    return close_loop_on(nominal, measured, machine, of_model, config, identify, given=given)
