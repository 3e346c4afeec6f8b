"""Stage `search`: one worker of a hyper-parameter study; any number of them may run at once."""

import dataclasses
import gc
import hashlib
import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jax
import numpy as np
from omegaconf import MISSING

from pipeline.configuration.paths import CheckpointFolder, InputPath, OutputFile, OutputFolder
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.search.search_space import propose
from pipeline.dynamics.search.trial_table import TrialRow, write_trials
from pipeline.dynamics.settings import IdentifyConfig, TrainingConfig
from pipeline.dynamics.training.data_split import split_by_purpose
from pipeline.dynamics.training.fit import TrainingDivergedError, fit
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from pipeline.study.configuration import SearchConfig
from pipeline.study.storage import refuse_password
from pipeline.study.trials import Trial, TrialOutcome
from pipeline.study.worker import DivergedError, RunningTrial, Study
from pipeline.tracking import StageRun, progress_bar

SCHEMA_VERSION = 1
FACTS = ("epochs", "best_epoch", "n_parameters")  # of `fit`'s metrics


@dataclass
class SearchStage(PipelineConfiguration):
    """Keys of `conf/search.yaml`."""

    identify: IdentifyConfig = MISSING
    search: SearchConfig = MISSING
    model: Parameterization = MISSING
    target: Target = MISSING
    tuples: InputPath = MISSING
    hold_out: list[str] = field(default_factory=list)
    n_trials: int = MISSING
    storage: OutputFile = MISSING
    checkpoints: CheckpointFolder = MISSING
    output: OutputFolder = MISSING

    def __post_init__(self) -> None:
        if isinstance(self.n_trials, int) and self.n_trials < 1:
            raise InputError(f"n_trials is {self.n_trials}; it must be at least 1")
        refuse_password(self.storage)


@stage(SearchStage)
def main(configuration: SearchStage, run: StageRun) -> None:
    """Work on the study of one model kind until its trials are finished, then write them as a table."""
    kind = f"{configuration.model.value}_{configuration.target.value}"
    trajectories = learning_part(configuration)
    run.inputs(configuration.tuples)
    space = configuration.search.spaces[configuration.model]
    definition = define(configuration, trajectories)
    name = f"{kind}_{_digest(definition)[:12]}"
    study: Study[TrainingConfig] = Study(
        configuration.storage, name, configuration.search.study, space.maximum_epochs
    )
    checkpoints = Path(configuration.checkpoints) / name
    trainer = Trainer(configuration, trajectories, checkpoints)
    n_trials, output = configuration.n_trials, Path(configuration.output)
    with progress_bar(f"search {name}", n_trials, "trial") as bar:

        def finished(trial: Trial) -> None:
            shutil.rmtree(checkpoints / f"trial_{trial.number}", ignore_errors=True)
            jax.clear_caches()  # else every trial's compiled programs, some 20 MB, would stay until the end
            gc.collect()
            bar.update(n_ended(study) - bar.n)
            if trial.value is not None:
                run.metrics({"evaluation_loss": trial.value}, step=trial.number)

        bar.update(n_ended(study))
        study.run(n_trials, lambda choose: propose(space, choose), trainer, finished)
    shutil.rmtree(checkpoints, ignore_errors=True)
    ended = [trial for trial in study.trials() if trial.outcome is not TrialOutcome.open]
    write_trials(output / "trials.csv", [row(trial, configuration) for trial in ended])
    meta = {"schema_version": SCHEMA_VERSION, "study": name, **definition}
    (output / "meta.json").write_text(json.dumps(meta, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    if study.finished_by() == study.identity:  # of several workers one reports the whole
        values = [trial.value for trial in ended if trial.value is not None]
        run.metrics({"trials": len(ended)} | ({"smallest_evaluation_loss": min(values)} if values else {}))
        run.artifact(output, "search")
    print(f"search: {len(ended)} trials of {name} in {output / 'trials.csv'}")


def n_ended(study: Study[TrainingConfig]) -> int:
    """Number of trials that are done with."""
    return sum(trial.outcome is not TrialOutcome.open for trial in study.trials())


class Trainer:
    """Trains the model of one trial."""

    def __init__(
        self, configuration: SearchStage, trajectories: Sequence[Trajectory], checkpoints: Path
    ) -> None:
        self._configuration = configuration
        self._trajectories = trajectories
        self._checkpoints = checkpoints

    def __call__(self, training: TrainingConfig, trial: RunningTrial) -> tuple[float, dict[str, Any]]:
        """L|eval and facts of the training, which goes on from its checkpoint where there is one."""
        first_epoch: int | None = None
        has_been_finite = False

        def progress(epoch: int, training_loss: float, evaluation_loss: float) -> None:
            nonlocal first_epoch, has_been_finite
            first_epoch = epoch if first_epoch is None else first_epoch
            has_been_finite = has_been_finite or bool(np.isfinite(evaluation_loss))
            # Parameters that are not finite stay so. A resumed run may have been finite before, which fit knows.
            if first_epoch == 1 and not has_been_finite and not np.isfinite(training_loss):
                raise DivergedError(f"no finite L|eval by epoch {epoch}")
            trial.report(epoch, evaluation_loss)

        configuration = self._configuration
        try:
            result = fit(
                self._trajectories,
                configuration.machine,
                configuration.model,
                configuration.target,
                training,
                configuration.identify,
                configuration.identify.seed,
                progress,
                self._checkpoints / f"trial_{trial.number}",
            )
        except TrainingDivergedError as error:
            raise DivergedError("no finite L|eval") from error
        return result.metrics["evaluation_loss"], {name: int(result.metrics[name]) for name in FACTS}


def learning_part(configuration: SearchStage) -> list[Trajectory]:
    """The trajectories that the search may see."""
    rows = split_by_purpose(Path(configuration.tuples), None, configuration.hold_out, configuration.machine)
    return rows.learning


def define(configuration: SearchStage, trajectories: Sequence[Trajectory]) -> dict[str, Any]:
    """All that a trial's result follows from. Its digest names the study: with other data it is another study."""
    identify = dataclasses.asdict(configuration.identify)
    of_no_influence = ("selected", "arx_ridge", "checkpoint_every_epochs", "long_prediction_steps")
    for name in of_no_influence:
        identify.pop(name, None)
    study = configuration.search.study
    content = {
        "model": configuration.model,
        "target": configuration.target,
        "machine": dataclasses.asdict(configuration.machine),
        "identify": identify,
        "space": dataclasses.asdict(configuration.search.spaces[configuration.model]),
        "seed": study.seed,
        "sampler": study.sampler,
        "startup_trials": study.startup_trials,
        "pruner": study.pruner,
        "pruner_warmup_epochs": study.pruner_warmup_epochs,
        "trajectories": {trajectory.name: _rows_digest(trajectory) for trajectory in trajectories},
    }
    return json.loads(json.dumps(content, default=str))


def row(trial: Trial, configuration: SearchStage) -> TrialRow:
    """A trial as a row of the table."""
    space = configuration.search.spaces[configuration.model]
    return TrialRow(
        trial=trial.number,
        state=trial.outcome.value,
        evaluation_loss=trial.value,
        training=propose(space, lambda name, options: trial.parameters[name]),
        seed=configuration.identify.seed,
        seconds=trial.seconds,
        attempts=trial.attempts,
        same_as=trial.facts.get("same_as"),
        reason=trial.reason,
        **{name: trial.facts.get(name) for name in FACTS},
    )


def _rows_digest(trajectory: Trajectory) -> str:
    digest = hashlib.sha256()
    for array in (trajectory.q, trajectory.qd, trajectory.a, trajectory.is_validation):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _digest(definition: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(definition, sort_keys=True).encode()).hexdigest()


if __name__ == "__main__":
    main()
