"""The page of a planned experiment, which an operator reads at the machine."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from pipeline.discrepancy.experiment.plan import FILE, Plan, Step, read_plan
from pipeline.errors import counted
from pipeline.files.atomic import write_whole
from pipeline.machine.specification import MachineSpecification
from pipeline.reporting.page import KeyFigure, Points, Section, render_page
from pipeline.reporting.table import Table

NAME = "experiment.html"


def write(folder: Path, machine: MachineSpecification) -> None:
    """Write the page beside the plan that `close_loop` wrote; nothing where it planned none.

    Raises:
        InputError: The plan is damaged, or the page cannot be written.
    """
    if not (folder / FILE).exists():
        (folder / NAME).unlink(missing_ok=True)
        return
    plan = read_plan(folder / FILE, machine)
    round_of = _one_round(plan.steps)
    times = len(plan.steps) // len(round_of)
    units = dict(zip(machine.joint_names, machine.units, strict=True))
    sections = [
        Section(
            "What to do",
            f"Play these {len(round_of)} steps {counted(times, 'time')}, without a break in the recording.",
            tables=[_steps(round_of, units)],
            points=[Points("Before it begins", list(_before(plan, units)))],
        ),
        Section(
            "What it decides",
            "Evidence is the expected logarithm of a likelihood ratio: 3 is 20 to 1, 7 is 1000 to 1.",
            tables=[_evidence(plan)],
            paragraphs=[f"It does not decide on {', '.join(plan.left_out)}."] if plan.left_out else [],
        ),
    ]
    figures = [
        KeyFigure(f"{plan.motion_s:.0f} s", "of motion"),
        KeyFigure(f"{plan.duration_s / 60:.1f} min", "in all"),
    ]
    page = render_page("The next experiment", plan.sentence, figures, sections, [("machine", machine.name)])
    write_whole(folder / NAME, page.encode())


def _one_round(steps: Sequence[Step]) -> Sequence[Step]:
    """The shortest part that all steps are a repetition of."""
    return next(
        steps[:n]
        for n in range(1, len(steps) + 1)
        if len(steps) % n == 0 and list(steps[:n]) * (len(steps) // n) == list(steps)
    )


def _before(plan: Plan, units: dict[str, str]) -> Iterable[str]:
    if plan.is_cold:
        yield "Let the machine stand until its oil is cold; then begin the recording at once."
    yield f"Bring the arm to {_place(plan.start, units)}, and let it rest."
    yield "Clear the area: the arm stays in the envelope by its model, which a changed machine need not follow."
    yield (
        "To be near a place means "
        + ", ".join(f"{name} ± {value:.2f} {units[name]}" for name, value in plan.tolerance.items())
        + "."
    )


def _steps(steps: Sequence[Step], units: dict[str, str]) -> Table:
    rows = []
    for number, step in enumerate(steps, start=1):
        if step.goal:
            told, seconds = f"Bring the arm near {_place(step.goal, units)}; let it rest.", ""
        elif step.command:
            held = " and ".join(f"{name} {value:+g}" for name, value in step.command.items())
            told, seconds = f"Hold {held}", f"{step.seconds:.2f}"
        else:
            told, seconds = "No command", f"{step.seconds:.2f}"
        rows.append([str(number), told, seconds])
    return Table("Steps", ["step", "what", "for [s]"], rows)


def _place(goal: Iterable, units: dict[str, str]) -> str:
    return ", ".join(f"{name} {value:.2f} {units[name]}" for name, value in dict(goal).items())


def _evidence(plan: Plan) -> Table:
    rows = [[*of.explanations, f"{of.evidence:.1f}"] for of in plan.separations]
    return Table("Expected evidence", ["if this is true", "against", "evidence"], rows)
