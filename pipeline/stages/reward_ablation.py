"""Stage `reward_ablation`: PPO with some terms of the reward left out, as the paper's appendix has it.

Outside `make repro` (`make ablation`). Finished trainings are kept; start it again to go on.
"""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import CheckpointFolder, InputPath
from pipeline.configuration.reaching import ReachingKeys
from pipeline.configuration.stage import stage
from pipeline.control.checkpoint import is_checkpoint
from pipeline.control.curve import CurvePoint
from pipeline.control.ppo import PPOConfig
from pipeline.control.reward_ablation import Ablation, RewardAblationConfig, save_cell
from pipeline.files.checkpoint_cleanup import remove_checkpoints
from pipeline.reporting.results.cells import read_cells
from pipeline.reporting.reward_ablation import write_ablation
from pipeline.tracking import ProgressBar, StageRun, progress_bar


@dataclass
class RewardAblationStage(ReachingKeys):
    """Keys of `conf/reward_ablation.yaml`."""

    ppo: PPOConfig = MISSING
    reward_ablation: RewardAblationConfig = MISSING
    cells: InputPath = MISSING
    checkpoints: CheckpointFolder = MISSING


@stage(RewardAblationStage)
def main(configuration: RewardAblationStage, run: StageRun) -> None:
    """Train what is not finished; after each training write tables and page anew."""
    model, settings = configuration.model, configuration.reward_ablation
    output, checkpoints = Path(configuration.output), Path(configuration.checkpoints)
    logs = str(read_cells(Path(configuration.cells), "logs")["logs"])
    ablation = Ablation.of_model(Path(model), configuration.reaching, configuration.ppo, settings)
    run.inputs(f"{model}/parameters.msgpack")
    provenance = [("profile", configuration.profile), ("model", model), ("made by", "make ablation")]
    for cell, training in ablation.unfinished(output / "cells", settings):
        with progress_bar(cell.name, settings.training_steps, "step") as bar:

            def progress(point: CurvePoint, bar: ProgressBar = bar) -> None:
                bar.reach(point.steps)

            result = ablation.run(cell, progress, checkpoints / cell.name)
        save_cell(output / "cells", cell, training, result)
        remove_checkpoints(checkpoints / cell.name, is_checkpoint)
        run.metrics({f"{cell.name}/{key}": value for key, value in result.metrics.items()})
        write_ablation(output, ablation, settings, logs, provenance)
    write_ablation(output, ablation, settings, logs, provenance)
    run.artifact(output, "reward_ablation")
    print(f"reward_ablation: open {output / 'index.html'}")


if __name__ == "__main__":
    main()
