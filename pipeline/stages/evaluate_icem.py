"""Stage `evaluate_icem`: iCEM plans through the fixed episodes, on the model that it plans with."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY, ControlConfiguration
from pipeline.configuration.paths import CheckpointFolder, InputModel, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.control.checkpoint import identity
from pipeline.control.chunks import evaluate_in_chunks, is_chunk
from pipeline.control.evaluate import controller_evaluation
from pipeline.control.icem.config import IcemConfig
from pipeline.control.icem.controller import icem_controller
from pipeline.control.icem.variant import RewardVariant, variant_reward
from pipeline.effects.store import load_dynamics
from pipeline.files.checkpoint_cleanup import remove_checkpoints
from pipeline.machine.kinematics import load_arm
from pipeline.reaching.episodes import EpisodesConfig, evaluation_episodes
from pipeline.reaching.evaluation_files import write_evaluation
from pipeline.reaching.metrics import reaching_metrics
from pipeline.reaching.reward import RewardConfig, total_reward
from pipeline.reaching.task import ReachingTask
from pipeline.tracking import StageRun, flatten_metrics, progress_bar


@dataclass
class EvaluateIcemStage(PipelineConfiguration):
    """Keys of `conf/evaluate_icem.yaml`."""

    control: ControlConfiguration = MISSING
    episodes: EpisodesConfig = MISSING
    reward: RewardConfig = MISSING
    icem: IcemConfig = MISSING
    model: InputModel = MISSING
    variant: RewardVariant = MISSING
    seed: int = MISSING
    checkpoints: CheckpointFolder | None = None
    output: OutputFolder = MISSING


@stage(EvaluateIcemStage)
def main(configuration: EvaluateIcemStage, run: StageRun) -> None:
    """Evaluate one variant; write metrics, success-rate matrix, episodes and traces as `evaluate_brax` does."""
    machine, conditions, icem = configuration.machine, configuration.episodes, configuration.icem
    output, repeats = Path(configuration.output), configuration.control.action_repeats
    arm = load_arm(machine, MACHINE_DIRECTORY)
    dynamics, parameters = load_dynamics(Path(configuration.model))
    run.inputs(f"{configuration.model}/parameters.msgpack")
    # The return is that of the reward planned with, as in the paper's table; see docs/controllers.md.
    reward = variant_reward(configuration.reward, configuration.variant)
    task = ReachingTask(machine, arm, dynamics, parameters, reward)
    episodes = evaluation_episodes(
        machine, arm, conditions, conditions.evaluation_seed, conditions.evaluation_episodes
    ).first(icem.first_episodes or conditions.evaluation_episodes)
    controller = icem_controller(task, icem, repeats)
    evaluate = controller_evaluation(controller, task, repeats, conditions.steps)
    specification = asdict(machine), asdict(dynamics.specification), parameters
    evaluation = identity(
        asdict(icem), asdict(reward), specification, (repeats, conditions.steps, configuration.seed), episodes
    )
    checkpoints = Path(configuration.checkpoints) if configuration.checkpoints else None
    description = f"{configuration.variant} seed {configuration.seed}"
    with progress_bar(description, len(episodes.starts), "episode") as bar:
        traces, terms = evaluate_in_chunks(
            lambda chunk, keys: evaluate(None, chunk, keys),
            episodes,
            configuration.seed,
            icem.chunk_episodes,
            checkpoints,
            evaluation,
            lambda n: bar.update(n) and None,
        )
    full = np.asarray(total_reward(configuration.reward, terms))
    metrics = {
        **reaching_metrics(traces).as_dict(),
        "average_return_full_reward": float(full.sum(axis=1, dtype=np.float64).mean()),
        "planning": {
            "horizon_entries": icem.horizon,
            "ticks_per_entry": icem.ticks_per_entry(repeats),
            "samples": icem.samples,
            "elites": icem.elites,
            "iterations": icem.iterations,
            "sequences_per_decision": icem.sequences_per_decision,
        },
    }
    write_evaluation(output, metrics, traces, episodes)
    run.metrics(flatten_metrics(metrics))
    run.artifact(output, "evaluation")
    if checkpoints:  # a finished evaluation must not be taken up again by changed code
        remove_checkpoints(checkpoints, is_chunk)


if __name__ == "__main__":
    main()
