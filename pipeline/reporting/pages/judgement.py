"""Tables and figures of judged models, made from the record that `judge` wrote."""

import csv
from collections.abc import Sequence
from pathlib import Path

from pipeline.dynamics.judged_models import RECORD, JudgedModels
from pipeline.files.atomic import write_json
from pipeline.files.record_file import load_record
from pipeline.machine.specification import MachineSpecification
from pipeline.reporting.figures.models import error_growth_band_figure, open_loop_prediction_figure
from pipeline.reporting.tables.judgement import (
    ReferenceComparison,
    display_name,
    error_comparison,
    extrapolation_comparison,
    grey_box_table,
    growth_comparison,
    growth_rows,
    narx_table,
)


def write(folder: Path, machine: MachineSpecification) -> None:
    """Write `tables`, `figures` and `comparisons.json` into the folder that `judge` wrote; say who wins.

    Raises:
        InputError: The record is missing or damaged.
    """
    judged = load_record(folder / RECORD, JudgedModels)
    compared = comparisons(judged, machine)
    write_tables(folder / "tables", compared, judged, machine)
    write_figures(folder / "figures", judged, machine)
    content = {name: comparison.content() for name, comparison in compared.items()}
    write_json(folder / "comparisons.json", content)
    for name, comparison in compared.items():
        print(f"{name}: {comparison.sentence()}")


def comparisons(judged: JudgedModels, machine: MachineSpecification) -> dict[str, ReferenceComparison]:
    """Models beside references: errors, their growth, behaviour outside the training distribution."""
    judgements, references, config = judged.judgements, judged.references, judged.config
    return {
        "errors": error_comparison(judgements, references, machine, judged.judged_on),
        "error_growth": growth_comparison(judgements, references, machine, config.growth.confidence),
        "extrapolation": extrapolation_comparison(judgements, references, machine, config.extrapolation),
    }


def write_tables(
    folder: Path,
    compared: dict[str, ReferenceComparison],
    judged: JudgedModels,
    machine: MachineSpecification,
) -> None:
    """Each comparison as Markdown and CSV, the error growth at every horizon, and what was fitted."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, comparison in compared.items():
        (folder / f"{name}.md").write_text(comparison.markdown(), encoding="utf-8")
        every_horizon = growth_rows(judged.judgements, machine)  # with bands; the table has a few horizons
        write_csv(folder / f"{name}.csv", *(every_horizon if name == "error_growth" else comparison.tidy()))
    for name, table in (
        ("narx", narx_table(judged.narx, machine)),
        ("grey_box", grey_box_table(judged.grey_box, machine)),
    ):
        (folder / f"{name}.md").write_text(table.markdown(), encoding="utf-8")


def write_figures(folder: Path, judged: JudgedModels, machine: MachineSpecification) -> None:
    """Open-loop predictions of the models and of the references, and error growth of all."""
    folder.mkdir(parents=True, exist_ok=True)
    names, units, judgements, references = (
        machine.joint_names,
        machine.units,
        judged.judgements,
        judged.references,
    )
    for file, own in (
        ("open_loop_models.svg", [name for name in judgements if name not in references]),
        ("open_loop_references.svg", references),
    ):
        predictions = {display_name(name): judgements[name].open_loop for name in own}
        (folder / file).write_bytes(open_loop_prediction_figure(predictions, names, units))
    growth = {display_name(name): one.growth for name, one in judgements.items()}
    shown = [display_name(name) for name in references]
    figure = error_growth_band_figure(growth, shown, machine.dt_s, names, units)
    (folder / "error_growth.svg").write_bytes(figure)


def write_csv(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A CSV file with a header."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
