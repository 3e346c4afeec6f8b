"""Stage `identify`: a dynamics model is trained by back-propagation through time and judged beside a linear ARX."""

import re
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
from omegaconf import MISSING

from pipeline.configuration.paths import CheckpointFolder, InputPath, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.dynamics.judgement import check_unseen, judge, long_prediction
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.model.store import save_model
from pipeline.dynamics.references.arx import fit_arx
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.dynamics.training.data_split import VALIDATION, split_by_purpose
from pipeline.dynamics.training.fit import fit
from pipeline.dynamics.training.windows import FIRST_JUDGED_ROW
from pipeline.errors import InputError
from pipeline.files.checkpoint_cleanup import remove_checkpoints
from pipeline.tracking import StageRun, flatten_metrics, progress_bar
from pipeline.tracking.registry.publish import publish_dynamics_model


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
    kind = f"{configuration.model.value}_{configuration.target.value}"
    if kind not in settings.selected:
        raise InputError(f"identify.selected has no {kind}; it has {', '.join(settings.selected)}")
    training = settings.selected[kind]
    held_out = Path(configuration.held_out) if configuration.held_out is not None else None
    rows = split_by_purpose(Path(configuration.tuples), held_out, configuration.hold_out, machine)
    if rows.judged_on == VALIDATION:
        print("identify: no held-out recording; judged on the validation rows, which early stopping saw")
    else:
        check_unseen(rows.learning, rows.judged)
    run.inputs(configuration.tuples, *([configuration.held_out] if configuration.held_out else []))
    with progress_bar(f"identify {kind}", training.maximum_epochs, "epoch") as bar:

        def progress(epoch: int, training_loss: float, evaluation_loss: float) -> None:
            bar.set_postfix(
                training=f"{training_loss:.2e}", evaluation=f"{evaluation_loss:.2e}", refresh=False
            )
            bar.update(epoch - bar.n)
            run.metrics({"training_loss": training_loss, "evaluation_loss": evaluation_loss}, step=epoch)

        result = fit(
            rows.learning,
            machine,
            configuration.model,
            configuration.target,
            training,
            settings,
            settings.seed,
            progress,
            Path(configuration.checkpoints) if configuration.checkpoints else None,
        )
    predictor = LearnedPredictor(result.model, result.parameters)
    arx = fit_arx(rows.learning, configuration.target, training.lags, machine.dt_s, settings.arx_ridge)
    arx = replace(arx, limits=(machine.lower, machine.upper))  # as the model's predictions
    metrics = result.metrics | judge({"model": predictor, "arx": arx}, rows.judged, machine)
    lineage = {
        "judged_on": rows.judged_on,
        "trajectories": [trajectory.name for trajectory in rows.learning],
        "machine": machine.name,
    }
    save_model(output, result.model, result.parameters, lineage, metrics, result.curves)
    prediction = long_prediction(predictor, rows.judged, FIRST_JUDGED_ROW, settings.long_prediction_steps)
    np.savez(output / "open_loop.npz", **asdict(prediction))
    run.metrics(flatten_metrics(metrics))
    run.artifact(output, "model")
    publish_dynamics_model(run, output, result.model, f"{machine.name}-{kind}", rows.learning[0])
    if configuration.checkpoints:  # a finished run must not be taken up again by changed code
        remove_checkpoints(Path(configuration.checkpoints), is_training)


def is_training(path: Path) -> bool:
    """Whether it is a folder of `dynamics.checkpoint`: named by a digest, a folder in it for each epoch kept."""
    is_named = re.fullmatch("[0-9a-f]{16}", path.name) is not None
    return is_named and path.is_dir() and all(entry.name.split(".")[0].isdigit() for entry in path.iterdir())


if __name__ == "__main__":
    main()
