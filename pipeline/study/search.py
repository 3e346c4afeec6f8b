"""Hyper-parameters of one model kind are searched: the study, the trainer of its trials, their table."""

import dataclasses
import gc
import hashlib
import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.search.search_space import propose
from pipeline.dynamics.search.trial_table import TrialRow, write_trials
from pipeline.dynamics.settings import IdentifyConfig, TrainingConfig
from pipeline.dynamics.training.fit import TrainingDivergedError, fit
from pipeline.errors import InputError
from pipeline.files.atomic import write_json
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification
from pipeline.study.configuration import SearchConfig
from pipeline.study.trials import Trial, TrialOutcome
from pipeline.study.worker import DivergedError, RunningTrial, Study

SCHEMA_VERSION = 1
FACTS = ("epochs", "best_epoch", "n_parameters")  # of `fit`'s metrics


@dataclasses.dataclass(frozen=True)
class SearchedKind:
    """One model kind, and all that the search for its hyper-parameters goes by.

    Attributes:
        trajectories: What the search may see.
    """

    machine: MachineSpecification
    identify: IdentifyConfig
    search: SearchConfig
    model: Parameterization
    target: Target
    trajectories: Sequence[Trajectory]


class KindStudy:
    """The study of one model kind, on which any number of processes may work at once."""

    def __init__(self, searched: SearchedKind, storage: str, checkpoints: Path) -> None:
        """Join the study, or begin it.

        Args:
            searched: What is searched.
            storage: A journal file or the address of a database.
            checkpoints: Folder from which a killed trial goes on.
        """
        self._searched = searched
        self._definition = define(searched)
        self.name = f"{searched.model.value}_{searched.target.value}_{_digest(self._definition)[:12]}"
        self._checkpoints = checkpoints / self.name
        maximum_epochs = searched.search.spaces[searched.model].maximum_epochs
        self._study: Study[TrainingConfig] = Study(storage, self.name, searched.search.study, maximum_epochs)

    @property
    def ended(self) -> list[Trial]:
        """The trials that are done with."""
        return [trial for trial in self._study.trials() if trial.outcome is not TrialOutcome.open]

    @property
    def is_finished_here(self) -> bool:
        """Whether this worker finished the study: of several one reports the whole."""
        return self._study.finished_by() == self._study.identity

    def run(
        self,
        n_trials: int,
        progress: Callable[[int], None],
        learned: Callable[[Mapping[str, float], int], None],
    ) -> None:
        """Work on the study until it has so many trials.

        Args:
            n_trials: Of all workers.
            progress: Called at first, and after each trial of this worker, with how many trials are done with.
            learned: Called with each trial of this worker that has a value: L|eval by name, and its number.

        Raises:
            InputError: The number of trials is below 1.
        """
        if n_trials < 1:
            raise InputError(f"n_trials is {n_trials}; it must be at least 1")

        def cleared(trial: Trial) -> None:
            shutil.rmtree(self._checkpoints / f"trial_{trial.number}", ignore_errors=True)
            jax.clear_caches()  # else every trial's compiled programs, some 20 MB, would stay until the end
            gc.collect()
            progress(len(self.ended))
            if trial.value is not None:
                learned({"evaluation_loss": trial.value}, trial.number)

        space = self._searched.search.spaces[self._searched.model]
        trainer = TrialTraining(self._searched, self._checkpoints)
        progress(len(self.ended))
        self._study.run(n_trials, lambda choose: propose(space, choose), trainer, cleared)
        shutil.rmtree(self._checkpoints, ignore_errors=True)

    @property
    def summary(self) -> dict[str, float]:
        """How many trials are done with, and the smallest L|eval of those that have one."""
        values = [trial.value for trial in self.ended if trial.value is not None]
        return {"trials": len(self.ended)} | ({"smallest_evaluation_loss": min(values)} if values else {})

    def write(self, output: Path) -> list[Trial]:
        """Write `trials.csv` and `meta.json`; the trials in them."""
        ended = self.ended
        write_trials(output / "trials.csv", [table_row(trial, self._searched) for trial in ended])
        meta = {"schema_version": SCHEMA_VERSION, "study": self.name, **self._definition}
        write_json(output / "meta.json", meta, sort_keys=True)
        return ended


class TrialTraining:
    """Trains the model of one trial."""

    def __init__(self, searched: SearchedKind, checkpoints: Path) -> None:
        self._searched = searched
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

        searched = self._searched
        try:
            result = fit(
                searched.trajectories,
                searched.machine,
                searched.model,
                searched.target,
                training,
                searched.identify,
                searched.identify.seed,
                progress,
                self._checkpoints / f"trial_{trial.number}",
            )
        except TrainingDivergedError as error:
            raise DivergedError("no finite L|eval") from error
        return result.metrics["evaluation_loss"], {name: int(result.metrics[name]) for name in FACTS}


def define(searched: SearchedKind) -> dict[str, Any]:
    """All that a trial's result follows from. Its digest names the study: with other data it is another study."""
    identify = dataclasses.asdict(searched.identify)
    of_no_influence = ("selected", "arx_ridge", "checkpoint_every_epochs", "long_prediction_steps")
    for name in of_no_influence:
        identify.pop(name, None)
    study = searched.search.study
    content = {
        "model": searched.model,
        "target": searched.target,
        "machine": dataclasses.asdict(searched.machine),
        "identify": identify,
        "space": dataclasses.asdict(searched.search.spaces[searched.model]),
        "seed": study.seed,
        "sampler": study.sampler,
        "startup_trials": study.startup_trials,
        "pruner": study.pruner,
        "pruner_warmup_epochs": study.pruner_warmup_epochs,
        "trajectories": {trajectory.name: _rows_digest(trajectory) for trajectory in searched.trajectories},
    }
    return json.loads(json.dumps(content, default=str))


def table_row(trial: Trial, searched: SearchedKind) -> TrialRow:
    """A trial as a row of the table."""
    space = searched.search.spaces[searched.model]
    return TrialRow(
        trial=trial.number,
        state=trial.outcome.value,
        evaluation_loss=trial.value,
        training=propose(space, lambda name, options: trial.parameters[name]),
        seed=searched.identify.seed,
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
