"""The index page's chapter on the closed loop: verdict, errors before and after, repair, and the seal's truth."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from pipeline.machine.specification import MachineSpecification
from pipeline.reporting.chapters.repair import repair_panel, repair_sentence, repair_table
from pipeline.reporting.closed_loop.figures import BASELINES
from pipeline.reporting.closed_loop.quantities import number, readable_unit, significant
from pipeline.reporting.closed_loop.verdict import HORIZON, affected_joints, held_out_error, verdict_sentence
from pipeline.reporting.figures.before_after import BeforeAfter, before_after_figure
from pipeline.reporting.page import SVG, Figure, Section
from pipeline.reporting.results.artifacts import ClosedLoopResult
from pipeline.reporting.table import Table

TITLE = "Closing the loop"


@dataclass(frozen=True)
class MachineUnits:
    """Joints and units of a machine, for the verdict's sentence."""

    joints: Sequence[str]
    units: Sequence[str]


def closed_loop_section(machine: MachineSpecification, result: ClosedLoopResult, output: Path) -> Section:
    """Build the chapter: the verdict on the measured logs, errors, repair, and the comparison with the seal.

    Args:
        result: Outputs of `close_loop` and `unseal`, and of `repair` where it ran.
        output: Folder of the page; the link to the loop's report is relative to it.
    """
    document = result.document
    if "verdict" not in document:
        return Section(TITLE, "The loop was not closed.", paragraphs=[f"{document['note']}."])
    tables, repaired = [closed_loop_table(machine, result)], []
    if result.repair is not None:
        tables.append(repair_table(result.repair))
        repaired = [repair_sentence(result.repair)]
    link = Markup('Evidence, rivals and the next experiment: <a href="{0}">{1}</a>.').format(
        os.path.relpath(result.page, output), result.page
    )
    return Section(
        TITLE,
        verdict_sentence(document, MachineUnits(machine.joint_names, machine.units)),
        _figures(machine, result),
        [table for table in tables if table is not None],
        [*repaired, seal_sentence(result.judgement), link],
    )


def _figures(machine: MachineSpecification, result: ClosedLoopResult) -> list[Figure]:
    """Errors and rates before and after, side by side; none where no policy was repaired."""
    panel = None if result.repair is None else repair_panel(result.repair)
    if panel is None:
        return []
    rows = {}
    for joint, factor, name, errors in _held_out_errors(machine, result.document):
        before, after = (factor * error for error in errors)
        rows[f"{joint} [{name}]"] = before, after
    panels = [BeforeAfter("4 s error of the model", ("before", "with what was found"), rows), panel]
    title = "From the error to the policy"
    caption = "Errors on measured rows that no fit saw. Both policies pursue the same targets in turns."
    return [Figure(title, caption, before_after_figure(panels), SVG)]


def closed_loop_table(machine: MachineSpecification, result: ClosedLoopResult) -> Table | None:
    """Four-second errors before and after per joint, beside the baselines; None if the loop was not closed."""
    document = result.document
    if "verdict" not in document:
        return None
    baselines = document.get("baselines") or {}
    shown = {name: label for name, (label, _) in BASELINES.items() if name in baselines}
    affected = affected_joints(document)
    rows = []
    for joint, factor, name, errors in _held_out_errors(machine, document):
        values = errors + [_error(baselines[baseline], joint) for baseline in (*shown, "nominal_floor")]
        label = f"{joint}, affected" if joint in affected else joint
        rows.append([f"{label} [{name}]", *(significant(factor * value) for value in values)])
    n_steps = document["held_out"]["n_steps"]
    return Table(
        f"4 s error (RMSE) of the model before and after, on {n_steps} measured steps that no fit saw",
        [
            "Joint",
            "Before",
            "With what was found",
            *(label.capitalize() for label in shown.values()),
            "On nominal logs",
        ],
        rows,
        ["On nominal logs: the uncorrected model on validation rows of the machine as it was."],
    )


def _held_out_errors(
    machine: MachineSpecification, document: Mapping[str, Any]
) -> Iterator[tuple[str, float, str, list[float]]]:
    """Per joint its name, factor and name of a readable unit, and the errors before and after."""
    for joint, unit in zip(machine.joint_names, machine.units, strict=True):
        factor, name = readable_unit(unit)
        yield joint, factor, name, [held_out_error(document, when, joint) for when in ("before", "after")]


def seal_sentence(judgement: Mapping[str, Any]) -> str:
    """The seal's truth and the verdict's grade, in two sentences."""
    if "note" in judgement:
        return f"No seal was opened: {judgement['note']}."
    truth = "; ".join(judgement["truth"]) or "nothing"
    return f"The seal, opened last, says that the simulated machine has {truth}. The verdict is {grade(judgement)}."


def grade(judgement: Mapping[str, Any]) -> str:
    """`right`, `wrong`, `not right` or `undecided`, and after a colon why."""
    truth, said = judgement["truth"], judgement["said"]
    if judgement["verdict_right"]:
        return "right: effect and joints are the true ones" if truth else "right"
    if not said:
        return "wrong: nothing was found" if truth else "undecided: the logs could not tell"
    if not truth:
        return "wrong: a false alarm"
    if judgement["family_right"]:
        return "undecided: what it names is true" if judgement["joints_right"] else "wrong about the joints"
    if judgement["among_equivalents"]:
        return "not right: the truth is among what it names, but not alone"
    return f"wrong: it says {'; '.join(said)}"


def _error(baseline: Mapping[str, Any], joint: str) -> float:
    return number((baseline.get(HORIZON) or {}).get(joint))
