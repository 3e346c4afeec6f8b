"""Stage `identify`: a dynamics model is trained by back-propagation through time and judged beside a linear ARX."""

from dataclasses import dataclass, field
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import CheckpointFolder, InputPath, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.dynamics.identify import identify
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.dynamics.training.checkpoint import is_training
from pipeline.dynamics.training.data_split import JUDGED_ROWS, split_by_purpose
from pipeline.files.checkpoint_cleanup import remove_checkpoints
from pipeline.tracking import StageRun, progress_bar
from pipeline.tracking.registry.publish import publish_identified


@dataclass
class IdentifyStage(PipelineConfiguration):
    """Keys of `conf/identify.yaml`."""

    identify: IdentifyConfig = MISSING
    model: Parameterization = MISSING
    target: Target = MISSING
    tuples: InputPath = MISSING
    held_out: InputPath | None = None
    hold_out: list[str] = field(default_factory=list)
    checkpoints: CheckpointFolder | None = None
    output: OutputFolder = MISSING


@stage(IdentifyStage)
def main(configuration: IdentifyStage, run: StageRun) -> None:
    """Train the model kind `model`, `target`, judge it on held-out rows and write the model folder."""
    machine, settings, output = configuration.machine, configuration.identify, Path(configuration.output)
    model, target, held_out = configuration.model, configuration.target, configuration.held_out
    kind = f"{model.value}_{target.value}"
    checkpoints = Path(configuration.checkpoints) if configuration.checkpoints else None
    rows = split_by_purpose(configuration.tuples, held_out, configuration.hold_out, machine)
    run.inputs(configuration.tuples, *([held_out] if held_out else []))
    with progress_bar(f"identify {kind}", settings.training_of(kind).maximum_epochs, "epoch") as bar:

        def progress(epoch: int, training: float, evaluation: float) -> None:
            bar.reach(epoch, training=f"{training:.2e}", evaluation=f"{evaluation:.2e}")
            run.metrics({"training_loss": training, "evaluation_loss": evaluation}, step=epoch)

        identified = identify(rows, machine, model, target, settings, progress, checkpoints)
    identified.save(output)
    publish_identified(run, output, identified, f"{machine.name}-{kind}", rows.learning[0])
    remove_checkpoints(checkpoints, is_training)
    own, arx = (identified.metrics[name]["open_loop_rmse_80"] for name in ("model", "arx"))
    errors = ", ".join(f"{joint} {own[joint]:.4f} (linear ARX {arx[joint]:.4f})" for joint in own)
    print(f"identify: 4 s error [rad or m] on the {JUDGED_ROWS[rows.judged_on]}: {errors}")


if __name__ == "__main__":
    main()
