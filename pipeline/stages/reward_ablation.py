"""Stage `reward_ablation`: PPO with some terms of the reward left out, as the paper's appendix has it.

Outside `make repro` (`make ablation`). Finished trainings are kept; start it again to go on.
"""

import dataclasses
from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY, ControlConfiguration
from pipeline.configuration.paths import CheckpointFolder, InputModel, InputPath, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.control.checkpoint import is_checkpoint
from pipeline.control.curve import CurvePoint
from pipeline.control.ppo import PPOConfig
from pipeline.control.reward_ablation import (
    Ablation,
    RewardAblationConfig,
    cells,
    finished,
    load_cell,
    save_cell,
)
from pipeline.effects.store import dynamics_fingerprint, load_dynamics
from pipeline.files.checkpoint_cleanup import remove_checkpoints
from pipeline.machine.kinematics import load_arm
from pipeline.reaching.episodes import EpisodesConfig
from pipeline.reaching.reward import RewardConfig
from pipeline.reporting.chapters.reward_ablation import ablation_beside_paper, ablation_page, ablation_table
from pipeline.reporting.report import write_table
from pipeline.reporting.results.cells import read_cells
from pipeline.reporting.results.paper import origin_of
from pipeline.tracking import StageRun, progress_bar


@dataclass
class RewardAblationStage(PipelineConfiguration):
    """Keys of `conf/reward_ablation.yaml`."""

    control: ControlConfiguration = MISSING
    episodes: EpisodesConfig = MISSING
    reward: RewardConfig = MISSING
    ppo: PPOConfig = MISSING
    reward_ablation: RewardAblationConfig = MISSING
    cells: InputPath = MISSING
    model: InputModel = MISSING
    checkpoints: CheckpointFolder = MISSING
    output: OutputFolder = MISSING


@stage(RewardAblationStage)
def main(configuration: RewardAblationStage, run: StageRun) -> None:
    """Train what is not finished; after each training write tables and page anew."""
    settings, output = configuration.reward_ablation, Path(configuration.output)
    logs_of(configuration)  # so that a mistake is told before the trainings
    ablation = shared(configuration)
    run.inputs(f"{configuration.model}/parameters.msgpack")
    for cell in cells(settings):
        training = ablation.identity(cell)
        if load_cell(output / "cells", cell, training) is not None:
            continue
        with progress_bar(cell.name, settings.training_steps, "step") as bar:

            def progress(point: CurvePoint, bar=bar) -> None:
                bar.update(min(point.steps, settings.training_steps) - bar.n)

            result = ablation.run(cell, progress, Path(configuration.checkpoints) / cell.name)
        save_cell(output / "cells", cell, training, result)
        remove_checkpoints(Path(configuration.checkpoints) / cell.name, is_checkpoint)
        run.metrics({f"{cell.name}/{key}": value for key, value in result.metrics.items()})
        write(configuration, ablation)
    write(configuration, ablation)
    run.artifact(output, "reward_ablation")
    print(f"reward_ablation: open {output / 'index.html'}")


def shared(configuration: RewardAblationStage) -> Ablation:
    """The task and the training that all cells share."""
    machine, settings, model = configuration.machine, configuration.reward_ablation, Path(configuration.model)
    dynamics, parameters = load_dynamics(model, machine)
    return Ablation(
        machine,
        load_arm(machine, MACHINE_DIRECTORY),
        dynamics,
        parameters,
        dynamics_fingerprint(model),
        configuration.reward,
        configuration.episodes,
        configuration.control.action_repeats,
        dataclasses.replace(
            configuration.ppo.for_model(dynamics.specification),
            model_kinds=configuration.ppo.model_kinds,  # finished cells are known by the section as it stands
            training_steps=settings.training_steps,
            evaluated_at_steps=settings.evaluated_at_steps,
        ),
    )


def logs_of(configuration: RewardAblationStage) -> str:
    """The folder of logs that the model is from."""
    return str(read_cells(Path(configuration.cells), "logs")["logs"])


def write(configuration: RewardAblationStage, ablation: Ablation) -> None:
    """Tables and page of what is finished."""
    output = Path(configuration.output)
    logs = logs_of(configuration)
    rows = finished(output / "cells", configuration.reward_ablation, ablation.identity)
    kind, origin = ablation.dynamics.specification.kind, origin_of(logs)
    write_table(ablation_table(rows, kind, origin), output / "tables", "reward_ablation")
    write_table(ablation_beside_paper(rows, kind, origin), output / "tables", "reward_ablation_beside_paper")
    provenance = [
        ("profile", configuration.profile),
        ("model", configuration.model),
        ("made by", "make ablation"),
    ]
    (output / "index.html").write_text(ablation_page(rows, kind, origin, provenance), encoding="utf-8")


if __name__ == "__main__":
    main()
