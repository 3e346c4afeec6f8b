"""The trials of a search as a table: `trials.csv`."""

import csv
import dataclasses
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.dynamics.search.selection import ModelCandidate
from pipeline.dynamics.settings import TrainingConfig
from pipeline.errors import InputError
from pipeline.files.atomic import write_whole

COMPLETE = "complete"
_LAYERS = "-"  # between the units of the hidden layers: 512-128


@dataclass(frozen=True)
class TrialRow:
    """A finished trial. Missing values are None, and empty cells in the table.

    Attributes:
        trial: Number within the study.
        state: complete, pruned, diverged or given_up.
        evaluation_loss: L|eval, rad².
        training: Hyper-parameters.
        seed: Seed of the training.
        epochs: Number of epochs trained.
        best_epoch: The epoch with the smallest L|eval.
        n_parameters: Number of the network's parameters.
        seconds: Wall time over all attempts, compilation included.
        attempts: Number of attempts; more than one if a worker died.
        same_as: Number of an earlier trial with equal hyper-parameters, whose result is copied.
        reason: Why L|eval is missing.
    """

    trial: int
    state: str
    evaluation_loss: float | None
    training: TrainingConfig
    seed: int
    epochs: int | None
    best_epoch: int | None
    n_parameters: int | None
    seconds: float
    attempts: int
    same_as: int | None
    reason: str


def write_trials(path: Path, rows: Sequence[TrialRow]) -> None:
    """Write the table in the order of the rows, atomically, as several workers may write it."""
    text = io.StringIO()
    fields = [field.name for field in dataclasses.fields(TrialRow) if field.name != "training"]
    training = [field.name for field in dataclasses.fields(TrainingConfig) if field.name != "ensemble"]
    writer = csv.DictWriter(text, [*fields[:3], *training, *fields[3:]], lineterminator="\n")
    writer.writeheader()
    for row in rows:
        cells = {name: getattr(row, name) for name in fields}
        cells |= {name: getattr(row.training, name) for name in training}
        cells |= {"hidden": _LAYERS.join(map(str, row.training.hidden)), "seconds": f"{row.seconds:.2f}"}
        writer.writerow(cells)
    write_whole(path, text.getvalue().encode())


def read_candidates(path: Path) -> list[ModelCandidate]:
    """The complete trials of a table, without ensembles; the first of those with equal hyper-parameters.

    Raises:
        InputError: if the file is missing or not a table of trials.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read ({error}); run the stage search") from error
    candidates = []
    for line, row in enumerate(rows, start=2):
        try:
            if row["state"] == COMPLETE and not row["same_as"]:
                candidates.append(_candidate(row))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"{path}: line {line} is not a trial ({type(error).__name__}: {error}); run the stage search again"
            ) from error
    return candidates


def _candidate(row: dict[str, str]) -> ModelCandidate:
    return ModelCandidate(
        trial=int(row["trial"]),
        training=TrainingConfig(
            hidden=[int(units) for units in row["hidden"].split(_LAYERS)],
            lags=int(row["lags"]),
            horizon=int(row["horizon"]),
            learning_rate=float(row["learning_rate"]),
            batch_size=int(row["batch_size"]),
            maximum_epochs=int(row["maximum_epochs"]),
        ),
        evaluation_loss=float(row["evaluation_loss"]),
        n_parameters=int(row["n_parameters"]),
    )
