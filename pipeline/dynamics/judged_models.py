"""Selected models judged beside an engineer's references, and the record that tables and figures are made from."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from pipeline.dynamics.comparison import reference_wins
from pipeline.dynamics.evaluation.errors import Predictor
from pipeline.dynamics.judgement import JudgeConfig, ModelJudgement, flat_metrics, judge_fully
from pipeline.dynamics.references.all_references import fit_references
from pipeline.dynamics.references.grey_box import GreyBoxPredictor
from pipeline.dynamics.references.narx import NarxPredictor
from pipeline.dynamics.training.data_split import DataSplit
from pipeline.files.atomic import write_json
from pipeline.files.record_file import save_record
from pipeline.machine.specification import MachineSpecification

RECORD = "judged.npz"


@dataclass(frozen=True)
class JudgedModels:
    """Everything that tables and figures show.

    Attributes:
        judgements: By predictor, the models first.
        references: Which of them are references.
        judged_on: A key of `data_split`: which rows they were judged on.
        narx: The fitted polynomial reference.
        grey_box: The fitted physical reference.
        config: How it was measured.
    """

    judgements: dict[str, ModelJudgement]
    references: list[str]
    judged_on: str
    narx: NarxPredictor
    grey_box: GreyBoxPredictor
    config: JudgeConfig

    def metrics(self, machine: MachineSpecification) -> dict[str, float]:
        """All figures, flat, and how often references win."""
        wins = reference_wins(self.judgements, self.references, machine.dt_s)
        return flat_metrics(self.judgements, machine) | wins

    def save(self, folder: Path, machine: MachineSpecification) -> dict[str, float]:
        """Write the metrics as `judgement.json`, and the record that pages are made from; the metrics."""
        metrics = self.metrics(machine)
        write_json(folder / "judgement.json", metrics, sort_keys=True, allow_nan=False)
        save_record(folder / RECORD, self)
        return metrics


def judge_models(
    models: Mapping[str, Predictor],
    rows: DataSplit,
    machine: MachineSpecification,
    config: JudgeConfig,
    progress: Callable[[str], None] = lambda name: None,
) -> JudgedModels:
    """Fit the references on the rows to learn from, and judge them and the models on the others.

    Args:
        models: By name.
        rows: To learn from and to judge on.
        config: Section `judge`.
        progress: Called with each predictor's name when it is done.

    Raises:
        InputError: The rows to judge on are too few.
    """
    fitted = fit_references(rows.learning, machine, config.arx, config.narx, config.grey_box)
    references: dict[str, Predictor] = dict(vars(fitted))
    judgements = judge_fully({**models, **references}, rows.learning, rows.judged, machine, config, progress)
    return JudgedModels(judgements, list(references), rows.judged_on, fitted.narx, fitted.grey_box, config)
